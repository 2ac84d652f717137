"""How long the figures took, from the times that the store keeps with every version."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from slapshot.benchmark.measures import Measure
from slapshot.benchmark.schedule import Job, core_seconds, critical_path
from slapshot.dag import STAGES, Plan
from slapshot.errors import InputError
from slapshot.store.folder import Store
from slapshot.store.version_file import read_version_file

# s in which nothing is made, though something is left: the start of a job takes less on a loaded machine.
_PAUSE = 60.0


@dataclass(frozen=True)
class Made:
    """One version of a run.

    Attributes:
        stage: its name.
        end: s, when it was finished.
        seconds: that making it took.
        after: names of the versions that it was made from.
    """

    stage: str
    end: float
    seconds: float
    after: tuple[str, ...] = ()


def figures_run(plan: Plan, store: Store) -> dict[str, Made]:
    """The versions that the figures of a plan were made from, in topological order.

    Raises:
        InputError: one is missing or damaged.
    """
    names: dict[tuple[str, str], str] = {}  # equal recipes under two labels are one version
    made = {}
    for label, recipe in plan.of_figures().items():
        if names.setdefault((recipe.stage, recipe.id), label) == label:
            version = read_version_file(store.folder(recipe.stage, recipe.id))
            end = datetime.fromisoformat(version["made_at"]).timestamp()
            after = tuple(names[pair] for pair in recipe.upstream.values())
            made[label] = Made(recipe.stage, end, version["seconds"], after)
    return made


def run_measures(made: Mapping[str, Made], cores: int) -> list[Measure]:
    """Wall time, core minutes of each stage, and the longest chain of dependent versions.

    The wall time is that from the first stage's begin to the last figure.

    Args:
        made: from `figures_run`.
        cores: of the machine on which they were made.

    Raises:
        InputError: they were not made in one go, so that they have no wall time.
    """
    jobs = {
        label: Job(one.seconds * min(STAGES[one.stage].threads, cores), STAGES[one.stage].threads, one.after)
        for label, one in made.items()
    }
    by_stage: dict[str, float] = {}
    for label, one in made.items():
        by_stage[one.stage] = by_stage.get(one.stage, 0.0) + jobs[label].core_seconds / 60
    return [
        Measure("figures_wall_minutes", _wall_seconds(made) / 60, "min"),
        Measure("figures_core_minutes", core_seconds(jobs) / 60, "min"),
        Measure("figures_critical_path_minutes", critical_path(jobs, cores) / 60, "min"),
        *(Measure(f"figures_{stage}_core_minutes", minutes, "min") for stage, minutes in by_stage.items()),
    ]


def _wall_seconds(made: Mapping[str, Made]) -> float:
    spans = sorted((one.end - one.seconds, one.end) for one in made.values())
    first, busy_until = spans[0][0], spans[0][1]
    for begin, end in spans:
        if begin > busy_until + _PAUSE:
            paused = datetime.fromtimestamp(busy_until).isoformat(" ", "minutes")
            raise InputError(
                f"the figures were not made in one go: nothing was made for {(begin - busy_until) / 60:.0f} "
                f"minutes from {paused}; run `make figures` in a fresh clone, then the benchmark"
            )
        busy_until = max(busy_until, end)
    return busy_until - first
