"""The `slapshot` command: what versions there are, why they are what they are, and whether they hold."""

import argparse
import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.table import Table

from slapshot.config.files import DEFAULT_CONFIG, read_config
from slapshot.dag import STAGES, Plan, in_words, load_plan, make_plan
from slapshot.errors import InputError, writing
from slapshot.own_code import own_code_may_run
from slapshot.scenes.domain import find_domain, is_built_in
from slapshot.store.archive import pack, unpack
from slapshot.store.folder import Store
from slapshot.store.garbage_collection import collect_garbage, find_version, flatten
from slapshot.store.recipe import Recipe
from slapshot.store.verify import compare, find_problems, make_lock, problem_of, remove_damaged
from slapshot.store.version_file import REPAIR, read_version_file
from slapshot.text import printable

LOCK = Path("data/pipeline.lock")
DEFAULT_STORE = Path("data/store")
CONFIGS = Path("config")
WHOLE, NOT_MADE = "whole", "not made yet"
_MOST_NAMED = 2  # versions of one stage that a list names one by one
# Labels and values may contain brackets, which are not markup; lines of text are not wrapped at 80 columns.
_WIDTH = None if sys.stdout.isatty() else 200
console = Console(highlight=False, markup=False, soft_wrap=True, width=_WIDTH)


def main() -> None:
    """Entry point."""
    args = _parser().parse_args()
    # SIGTERM raises SystemExit, so that context managers remove unfinished files.
    before = signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    try:
        sys.exit(args.run(args))
    except InputError as error:
        print(f"slapshot: {error}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(
            f"slapshot: {printable(f'{where}{error.strerror or error}')}; name another path", file=sys.stderr
        )
        sys.exit(1)
    except KeyboardInterrupt:
        print("slapshot: interrupted", file=sys.stderr)
        sys.exit(128 + signal.SIGINT)
    finally:
        signal.signal(signal.SIGTERM, before)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="slapshot", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    versions = commands.add_parser("versions", help="data versions").add_subparsers(
        required=True, metavar="COMMAND"
    )
    for name, run, text in (
        ("list", _list, "every version in the store"),
        ("diff", _diff, "what two versions were made from, side by side"),
        ("why", _why, "why a stage's version is, or is not, there"),
        ("gc", _gc, "remove versions that no configuration asks for: none given, or none of config/"),
        ("lock", _lock, "write data/pipeline.lock from the default configuration"),
        (
            "verify",
            _verify,
            "are versions whole, and the default ones as in data/pipeline.lock",
        ),
        ("pack", _pack, "versions in one file, to go on with them on another machine"),
        ("unpack", _unpack, "put the versions of such a file into the store"),
    ):
        command = versions.add_parser(name, help=text, description=text)
        command.set_defaults(run=run)
        command.add_argument("--store", type=Path, default=DEFAULT_STORE)
        if name == "diff":
            command.add_argument("first", help="id, or the beginning of one")
            command.add_argument("second")
        if name == "why":
            command.add_argument("stage", help="for example rollouts")
        if name == "gc":
            command.add_argument("--yes", action="store_true", help="remove, do not only list")
        if name == "verify":
            command.add_argument(
                "--repair", action="store_true", help="remove what is damaged and all that was made from it"
            )
        if name in {"pack", "unpack"}:
            command.add_argument("file", type=Path, help="such as verdicts.tar.xz")
        if name == "pack":
            command.add_argument("--stage", action="append", default=[], help="alone; may be repeated")
        if name in {"why", "gc", "verify"}:
            command.add_argument(
                "--config", type=Path, action="append", help="configuration; may be repeated"
            )
    stage = commands.add_parser("stage", help="make the versions of one stage, whose inputs are there")
    stage.add_argument("stage", help="for example rollouts")
    stage.add_argument("--config", type=Path, action="append", help="configuration, else the default")
    stage.add_argument("--store", type=Path, default=DEFAULT_STORE)
    stage.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    stage.set_defaults(run=_stage)
    config = commands.add_parser("config", help="check a configuration")
    config.add_argument("file", type=Path)
    config.set_defaults(run=_config)
    check = commands.add_parser("check", help="check a recording and say what is in it")
    check.add_argument("recording", help="folder")
    check.set_defaults(run=_check)
    importing = commands.add_parser("import", help="make a recording of CSV files")
    importing.add_argument("mapping", type=Path, help="YAML file that says which column is what")
    importing.add_argument("source", type=Path, help="folder of CSV files, one of them, or a path with *")
    importing.add_argument("out", type=Path, help="folder of the recording, which must not exist yet")
    importing.set_defaults(run=_import)
    diagnosing = commands.add_parser(
        "diagnose", help="say what physics a scene lacks that a recording shows, and model it"
    )
    diagnosing.add_argument("recording", type=Path, help="folder")
    diagnosing.add_argument("--out", type=Path, required=True, help="folder to make")
    diagnosing.add_argument("--rig", type=Path, help="rig file (YAML) of the nominal scene or model")
    diagnosing.add_argument(
        "--model", type=Path, help="MJCF or URDF, where the recording's channels name its parts"
    )
    diagnosing.add_argument(
        "--config", type=Path, help="of hits: configuration that says the same, else the default"
    )
    diagnosing.add_argument("--domain", default="hockey", help="of hits: domain of the configuration")
    diagnosing.add_argument(
        "--signatures", type=Path, help="of hits: file with those of commands, made if missing"
    )
    diagnosing.add_argument("--seed", type=_seed, default=0, help="of what is drawn")
    diagnosing.set_defaults(run=_diagnose)
    browse = commands.add_parser("browse", help="look at hits in the Rerun viewer")
    browse.add_argument("--config", type=Path, help="configuration whose hits are shown, else the default")
    browse.add_argument("--store", type=Path, default=DEFAULT_STORE)
    browse.add_argument("--hit", help="open only this hit: a file, or part of its name")
    browse.add_argument("--port", type=int, default=51234, help="of the gallery; 0 for any that is free")
    browse.set_defaults(run=_browse)
    return parser


def _store(args: argparse.Namespace) -> Store:
    """The store given on the command line.

    Raises:
        InputError: the given one is no folder; the default one may be missing, and is then empty.
    """
    if args.store != DEFAULT_STORE and not args.store.is_dir():
        raise InputError(
            f"--store {args.store}: is no folder; name the folder of a store, such as data/store"
        )
    return Store(args.store)


def _seed(text: str) -> int:
    """A seed from the command line."""
    seed = int(text)
    if not 0 <= seed < 2**32:
        raise ValueError
    return seed


def _browse(args: argparse.Namespace) -> int:
    try:  # imported here, because all other commands work without Rerun
        from slapshot.viewer.browse import browse, show
    except ModuleNotFoundError as error:
        raise InputError(f"browse needs {error.name}, which is not installed: run `make setup`") from None
    if args.hit and Path(args.hit).is_file():
        return show(Path(args.hit))
    recipes = load_plan(args.config).of_stage("viewer").values()
    option = f" --configfile {args.config}" if args.config else ""
    return browse(recipes, f"snakemake recordings{option}", Store(args.store), args.hit, args.port)


def _check(args: argparse.Namespace) -> int:
    from slapshot.recordings.cli import run_check  # imports SciPy and pandas; other commands start faster

    return run_check(args)


def _import(args: argparse.Namespace) -> int:
    from slapshot.recordings.cli import run_import

    return run_import(args)


def _diagnose(args: argparse.Namespace) -> int:
    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is rendered, so no display is needed
    from slapshot.recordings.read import format_version  # imports of MuJoCo and figures; others start faster

    match format_version(args.recording):
        case 1:
            if args.model is not None:
                raise InputError(
                    "--model is of joints and bodies; for hits of an object give --rig or --config"
                )
            from slapshot.diagnosis.pucks.command import run_diagnose
        case _:
            from slapshot.diagnosis.cli import run_diagnose
    with own_code_may_run():  # effects that a rig file names
        return run_diagnose(args)


def _say(text: str) -> None:
    """Print a line, with unprintable characters in file names escaped."""
    console.print(printable(text))


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for name in columns:
        table.add_column(name, overflow="fold")
    return table


def _stage(args: argparse.Namespace) -> int:
    for label, recipe in _of_stage(args).items():
        # One process per version, as in the workflow: a stage sets the number of threads of its libraries.
        module = STAGES[recipe.stage].module.removesuffix(".__main__")
        command = [sys.executable, "-m", module, "--recipe", recipe.to_json(), "--label", in_words(label)]
        done = subprocess.run([*command, "--store", args.store, "--cores", str(args.cores)], check=False)
        if done.returncode:
            return done.returncode
    return 0


def _of_stage(args: argparse.Namespace) -> dict[str, Recipe]:
    """Label -> recipe of the stage given on the command line.

    Raises:
        InputError: the configuration asks for no version of it.
    """
    plan = _plan_of(args.config)
    wanted = plan.of_stage(args.stage)
    if not wanted:
        raise InputError(f"no stage {args.stage!r}; stages: {', '.join(plan.ids())}")
    return wanted


def _config(args: argparse.Namespace) -> int:
    checked = read_config([args.file])
    plan = make_plan(checked.settings, checked.layers.where)
    _say(f"{args.file}: {len(plan.recipes)} versions")
    for name, domain in checked.settings.domains.items():
        if not is_built_in(domain.scene.domain):
            source = find_domain(domain.scene.domain)
            _say(f"domains.{name}.scene.domain: {source} is code of its own, which stages will run")
    return 0


def _list(args: argparse.Namespace) -> int:
    table = _table("what", "id", "made at", "took", "from")
    store = _store(args)
    _say_unreadable(store)
    for _, version in store.versions():
        recipe = version["recipe"]
        sources = _sources([(stage, i[:6]) for stage, i in recipe["upstream"].values()])
        table.add_row(
            printable(str(version.get("label") or recipe["stage"])),
            version["id"],
            printable(str(version["made_at"])),
            f"{version['seconds']:.0f} s",
            sources,
        )
    console.print(table)
    return 0


def _sources(upstream: list[tuple[str, str]]) -> str:
    """Short list of upstream versions; if there are many of one stage, only their number."""
    counts = Counter(stage for stage, _ in upstream)
    few = [f"{stage}/{i}" for stage, i in upstream if counts[stage] <= _MOST_NAMED]
    return " ".join([*few, *(f"{n} {stage}s" for stage, n in counts.items() if n > _MOST_NAMED)])


def _diff(args: argparse.Namespace) -> int:
    store = _store(args)
    _say_unreadable(store)
    first, second = find_version(store, args.first), find_version(store, args.second)
    _print_difference(flatten(first["recipe"]), flatten(second["recipe"]), first["id"], second["id"])
    return 0


def _print_difference(first: dict[str, object], second: dict[str, object], a: str, b: str) -> None:
    table = _table("key", a, b)
    for key in sorted(set(first) | set(second)):
        if first.get(key) != second.get(key):
            table.add_row(*map(printable, (key, str(first.get(key, "-")), str(second.get(key, "-")))))
    if table.row_count:
        console.print(table)
    else:
        _say("no difference")


def _why(args: argparse.Namespace) -> int:
    store, wanted = _store(args), _of_stage(args)
    _say_unreadable(store)
    made = [v for _, v in store.versions() if v["recipe"]["stage"] == args.stage]
    for label, recipe in wanted.items():
        if store.is_whole(recipe.stage, recipe.id):
            _say(f"{label}: {recipe.id} is there")
            continue
        if not made:
            _say(f"{label}: {recipe.id} is to be made; there is no version of it yet")
            continue
        ours = flatten(json.loads(recipe.to_json()))
        nearest = min(made, key=lambda v: _distance(ours, flatten(v["recipe"])))
        _say(f"{label}: {recipe.id} is to be made; the nearest version there is differs in")
        _print_difference(flatten(nearest["recipe"]), ours, nearest["id"], recipe.id)
    return 0


def _distance(first: dict[str, object], second: dict[str, object]) -> int:
    return sum(first.get(key) != second.get(key) for key in set(first) | set(second))


def _gc(args: argparse.Namespace) -> int:
    # By default versions of any configuration of the project are kept: even a tiny run takes minutes.
    keep = _plan_of(args.config or sorted(CONFIGS.glob("*.yaml"))).ids()
    removed = collect_garbage(_store(args), keep, really=args.yes)
    for folder, size in removed:
        _say(f"{folder}  {size / 1e6:.1f} MB")
    word = "removed" if args.yes else "would be removed; add --yes to do it"
    _say(f"{len(removed)} folders, {sum(s for _, s in removed) / 1e6:.1f} MB {word}")
    return 0


def _lock(args: argparse.Namespace) -> int:
    recipes, store = load_plan().of_figures(), _store(args)
    for label, recipe in recipes.items():
        if not store.is_whole(recipe.stage, recipe.id):
            raise InputError(f"{label} is not made yet: run `snakemake figures` first")
    text = json.dumps(make_lock(store, recipes), indent=1, sort_keys=True)
    with writing(LOCK):
        LOCK.parent.mkdir(parents=True, exist_ok=True)
        LOCK.write_text(text + "\n")
    _say(f"{LOCK}: {len(recipes)} versions")
    return 0


def _verify(args: argparse.Namespace) -> int:
    store = _store(args)
    if args.repair:
        return _repair(store, _plan_of(args.config))
    default = [path for path in args.config or [DEFAULT_CONFIG] if path.resolve() == DEFAULT_CONFIG.resolve()]
    others = [path for path in args.config or [] if path not in default]
    good = True
    if default:
        good = _reproduces(store, load_plan())
    if others:
        good = _all_whole(store, _plan_of(others)) and good
    return 0 if good else 1


def _reproduces(store: Store, plan: Plan) -> bool:
    """Compare the versions of `figures` with the lock; report problems of versions on demand."""
    if not LOCK.is_file():
        raise InputError(f"{LOCK} is missing: restore it from git")
    try:
        lock = json.loads(LOCK.read_text())
    except ValueError as error:
        raise InputError(f"{LOCK} is damaged ({error}): restore it from git") from None
    verdicts = compare(store, plan.of_figures(), lock)
    on_demand = {label: _state(store, plan.recipes[label]) for label in sorted(plan.on_demand)}
    verdicts |= {label: state for label, state in on_demand.items() if state not in {WHOLE, NOT_MADE}}
    for label, verdict in verdicts.items():
        _say(f"{label}: {verdict}")
    good = all(v.startswith(("identical", "equal")) for v in verdicts.values())
    _say("reproduced" if good else "not reproduced")
    return good


def _all_whole(store: Store, plan: Plan) -> bool:
    """Print the state of each version of a plan; those on demand may be missing."""
    states = {label: _state(store, recipe) for label, recipe in plan.recipes.items()}
    shown = {n: state for n, state in states.items() if state != NOT_MADE or n not in plan.on_demand}
    for label, state in shown.items():
        _say(f"{label}: {state}")
    good = set(shown.values()) <= {WHOLE}
    _say("all whole" if good else "not all whole")
    return good


def _state(store: Store, recipe: Recipe) -> str:
    """Whole, not made yet, or the problem and what to do about it."""
    if not store.folder(recipe.stage, recipe.id).exists():
        return NOT_MADE
    problem = problem_of(store, (recipe.stage, recipe.id))
    return f"{problem}; {REPAIR}" if problem else WHOLE


def _repair(store: Store, plan: Plan) -> int:
    asked = {(recipe.stage, recipe.id) for recipe in plan.recipes.values()}
    problems = find_problems(store, asked)
    removed = remove_damaged(store, problems, plan.recipes.values())
    for (stage, version_id), why in removed.items():
        _say(f"removed {stage}/{version_id}: {why}")
    busy = [f"{stage}/{version_id}" for stage, version_id in problems if (stage, version_id) not in removed]
    if busy:
        raise InputError(f"{', '.join(busy)}: being made just now; wait until it is, and run this again")
    _say(f"{len(removed)} versions removed" if removed else "nothing is damaged")
    return 0


def _pack(args: argparse.Namespace) -> int:
    packed = pack(_store(args), args.file, args.stage)
    _say(f"{args.file}: {len(packed)} versions")
    return 0


def _unpack(args: argparse.Namespace) -> int:
    added = unpack(_store(args), args.file)
    _say(f"{args.store}: {len(added)} versions added")
    return 0


def _say_unreadable(store: Store) -> None:
    """Print one line for each version whose version.json is damaged; such versions are skipped."""
    for folder in store.folders():
        try:
            read_version_file(folder)
        except InputError as error:
            print(f"slapshot: {error}", file=sys.stderr)


def _plan_of(configs: list[Path] | None) -> Plan:
    """Recipes of all given configurations together, or of the default one if none is given."""
    merged = Plan()
    paths: list[Path | None] = [*configs] if configs else [None]
    for path in paths:
        name = str(path or "default")
        plan = load_plan(path)
        begin = f"{name}:" if len(paths) > 1 else ""
        merged.recipes |= {f"{begin}{label}": recipe for label, recipe in plan.recipes.items()}
        merged.on_demand |= {f"{begin}{label}" for label in plan.on_demand}
    return merged
