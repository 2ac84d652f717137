# The plan turns the configuration into recipes; a rule's only wildcard is a version: what it is, and its id.

shell.prefix("set -euo pipefail; ")

# Only the rules that draw pictures of a scene need a GL library.
os.environ.setdefault("MUJOCO_GL", "disable")
# Threads of torch that spin while they wait make training many times slower when anything else runs.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# Said of every job that fails: the mark of a version that is not there yet has no earlier state.
logger.addFilter(lambda record: "no backup found" not in record.getMessage())

store = Store(Path("data/store"))

try:
    # Read again: Snakemake takes the last of repeated keys, and does not say where a value stands.
    checked = read_config(
        workflow.overwrite_configfiles, workflow.config_settings.config
    )
    config = checked.layers.values
    if config["proof"] == "fresh" and not FRESH.exists():
        # Here, because the kinds of physics take long to import.
        from slapshot.blind_validation.lists import draw_file

        draw_file("full", FRESH)
    plan = make_plan(checked.settings, checked.layers.where)
except InputError as error:
    raise WorkflowError(str(error)) from None

marks = Marks(Path("data/marks"), plan)
marks.refresh(store)

# Of this machine; on a cluster there is no such number, and workflow.cores is an error.
cores = workflow.resource_settings.cores or 1

# Snakemake says how many jobs are done; how long the rest takes, it cannot know.
time_left = TimeLeft(store, cores)
logger.addFilter(time_left)


onstart:
    time_left.say()


def of_figures(stage=None):
    """Marks of what belongs to the figures, of one stage or of all."""
    recipes = plan.of_figures().values()
    return [str(marks.of(r)) for r in recipes if stage in (None, r.stage)]


def of_domain(domain):
    """Marks of the figures of one domain."""
    labels = (l for l in plan.of_figures() if l.startswith(f"figure/{domain}/"))
    return [mark_of(label) for label in labels]


def marks_of(stage):
    """Marks of what the target of a stage makes: of those that figures need, no version made on demand."""
    if not stage.on_demand:
        return of_figures(stage.name)
    return [str(marks.of(recipe)) for recipe in plan.of_stage(stage.name).values()]


def version(stage):
    """Pattern of the mark of a stage's versions.

    To be updated, because Snakemake removes any other output before a job: of two runs at once, one would
    take away the mark of a version that the other has made, and jobs that need it would wait in vain.
    """
    return update(str(marks.pattern(stage)))


def upstream(stage):
    """Input function: marks of the versions that a version reads."""

    def find(wildcards):
        return [
            str(mark) for mark in marks.above(marks.recipe(stage, wildcards.version))
        ]

    return find


def recipe(stage):
    """Params function: the recipe, in one canonical string."""
    return lambda wildcards: marks.recipe(stage, wildcards.version).to_json()


def label(stage):
    """Params function: what the version is, in words."""
    return lambda wildcards: marks.label(marks.recipe(stage, wildcards.version))


def again_with_twice(amount):
    """Resource function: twice as much of it each time that a cluster ended the job for want of it."""
    return lambda wildcards, attempt: amount * 2 ** (attempt - 1)


def mark_of(label):
    """Mark of the version with that label."""
    if label not in plan.recipes:
        raise WorkflowError(
            f"the configuration asks for no {label}; see `cases` and `recordings` in it"
        )
    return str(marks.of(plan.recipes[label]))


def folder_of(label):
    """Folder of the version with that label."""
    return str(store.folder(plan.recipes[label].stage, plan.recipes[label].id))


def reported():
    """What the report shows of this configuration."""
    copies = [f"data/report/{name}.png" for name in plan.names_of("figure")]
    return copies + ["data/report/claims.html"] * ("claims" in plan.recipes)
