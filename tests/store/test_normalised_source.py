"""What cannot change a result stays out of the digest of code, and everything else is in it."""

import ast
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from slapshot.dag import CLAIMS, FIGURES, STAGES
from slapshot.store.code_dependencies import find_source, imported_libraries, module_closure
from slapshot.store.normalised_source import NEUTRAL, read_source

PACKAGE = Path(__file__).parents[2] / "pipeline_src/slapshot"
HEAD = """
import logging
from slapshot.errors import InputError
from slapshot.progress import progress
from slapshot.validation import ProblemAtError
log = logging.getLogger("slapshot")
"""
BODY = """
def run(items, count, rng):
    total = 0
    for item in items:
        total += item
    return total
"""


@pytest.fixture
def digest(tmp_path):
    """Text of a module -> its digest."""
    numbers = iter(range(1000))

    def digest(text: str) -> str:
        file = tmp_path / f"module_{next(numbers)}.py"
        file.write_text(text)
        return read_source("module", file).digest

    return digest


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (BODY, HEAD + BODY),
        (BODY, "from slapshot.command import Run, stage_command\n" + BODY),
        ("from slapshot.errors import check_writable\n" + BODY,
         "from slapshot.errors import InputError, check_writable, reading\n" + BODY),
        (BODY, HEAD + BODY.replace("    ret", '    log.info("%d of %s", total, f"{items[0].x}")\n    ret')),
        (BODY, HEAD + BODY.replace("    ret", '    log.debug("%d", len(items) + round(-total, 2))\n    ret')),
        (BODY, HEAD + BODY.replace("        total +=", '        log.warning("odd")\n        total +=')),
        (BODY, HEAD + BODY.replace("in items", 'in progress(items, len(items), "steps")')),
        (BODY, HEAD + BODY.replace("in items", 'in progress(items, -(-count // 2), f"{count}", done=3)')),
        (BODY, HEAD.replace("progress import progress", "progress import progress as bar")
         + BODY.replace("in items", 'in bar(items, count, "steps")')),
        ("def f():\n    pass\n", HEAD + 'def f():\n    log.info("only this")\n'),
        ("try:\n    x = 1\nexcept ValueError:\n    pass\n",
         HEAD + 'try:\n    x = 1\nexcept ValueError:\n    log.error("bad")\n'),
        ("try:\n    x = 1\nfinally:\n    pass\n", HEAD + 'try:\n    x = 1\nfinally:\n    log.error("end")\n'),
    ],
)  # fmt: skip
def test_showing_and_logging_do_not_count(digest, before, after):
    assert digest(after) == digest(before)


FIELD = "from pydantic import Field\nx: int = Field({})\n"
OTHER = FIELD.replace("pydantic", "other")
RAISE = HEAD + "\ndef f(x, rng):\n    if x:\n        raise InputError({})\n"
LOG = HEAD + "\ndef f(x, rng):\n    log.info({})\n"


@pytest.mark.parametrize(
    ("text", "one", "other"),
    [
        (RAISE, '"bad"', '"worse"'),
        (RAISE, '"bad"', 'f"bad {x}"'),
        (RAISE, '"bad"', '"bad") from (None'),
        (RAISE.replace("InputError(", "ProblemAtError((), "), '"bad"', 'f"bad {x}"'),
        (FIELD, 'ge=0, description="one"', "ge=0"),
        (LOG, '"one %s", rng.normal()', '"two %s", rng.normal()'),  # the words, not the draw
    ],
)
def test_wording_does_not_count(digest, text, one, other):
    assert digest(text.format(one)) == digest(text.format(other))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        # What a message evaluates may change what comes after it.
        (LOG.format('"%s", x'), LOG.format('"%s", rng.normal()')),
        (LOG.format('"%s", rng.normal()'), LOG.format('"%s", rng.normal(2)')),
        (LOG.format('"%s", x'), LOG.format('"%s", [r for r in rng]')),
        (LOG.format('"%s", x'), LOG.format('"%s", (x := 2)')),
        (LOG.format('"%s", x'), LOG.format('"%s", sum(rng)')),
        # Something else by the same name.
        ("def f(log):\n    log.info(1)\n", "def f(log):\n    log.info(2)\n"),
        (HEAD + "def f(log):\n    log.info(1)\n", HEAD + "def f(log):\n    log.info(2)\n"),
        (HEAD + "log = {}\nlog.info(1)\n", HEAD + "log = {}\nlog.info(2)\n"),
        ("from other import progress\nprogress([1], 1)\n", "from other import progress\nprogress([1], 2)\n"),
        (HEAD + "progress = max\nx = progress([1], 1)\n", HEAD + "progress = max\nx = progress([1], 2)\n"),
        ("class InputError(Exception): ...\nraise InputError(1)\n",
         "class InputError(Exception): ...\nraise InputError(2)\n"),
        # Not a message.
        (FIELD.format("ge=0"), FIELD.format("ge=1")),
        (OTHER.format("description=1"), OTHER.format("description=2")),
        (HEAD + "log.setLevel(1)\n", HEAD + "log.setLevel(2)\n"),
        (HEAD + "x = log.info(1)\n", HEAD + "x = log.info(2)\n"),
        ("raise ValueError('one')\n", "raise ValueError('two')\n"),  # a stage may note it
        (HEAD + "def f(): raise InputError('one')\n", HEAD + "def f(): raise ValueError('one')\n"),
        (HEAD + "def f(x):\n    if x: raise InputError('')\n", HEAD + "def f(x): raise InputError('')\n"),
        (HEAD + "for i in progress([1], 1, 'a'): i\n", HEAD + "for i in progress([2], 1, 'a'): i\n"),
        (HEAD + "for i in progress(a, b(), 'a'): i\n", HEAD + "for i in progress(a, c(), 'a'): i\n"),
        (BODY, "from slapshot.errors import check_writable\n" + BODY),
        (BODY, "from slapshot import progress\n" + BODY),
        ("from slapshot.parquet import read_table\n", "from slapshot.parquet import read_frame\n"),
        ("if TYPE_CHECKING:\n    import a\nelse:\n    import b\n", "if TYPE_CHECKING:\n    import a\n"),
    ],
)  # fmt: skip
def test_what_may_change_a_result_counts(digest, one, other):
    assert digest(one) != digest(other)


def test_imports_for_type_checkers_alone_are_none(tmp_path):
    file = tmp_path / "module.py"
    file.write_text(
        "import typing\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import torch\n"
        "if typing.TYPE_CHECKING:\n    from scipy import stats\nelse:\n    import numba\n"
        "def late():\n    import pandas as pd\n    from importlib import import_module\n"
        "    import_module('rerun.server')\n    importlib.util.find_spec('mujoco')\n    import_module(late)\n"
    )
    imports = set(read_source("module", file).imports)
    assert {name.split(".")[0] for name in imports} == {
        "typing", "numba", "pandas", "importlib", "rerun", "mujoco"
    }  # fmt: skip


# --- the package itself ---------------------------------------------------------------------------------

# Modules behind the names of NEUTRAL, with the rest of the store.
BEHIND = (
    "slapshot.command",
    "slapshot.errors",
    "slapshot.progress",
    "slapshot.store",
    "slapshot.validation",
)
# What they may import beside the standard library and each other. (verify.py, which no stage runs, computes
# statistics for the lock.)
MAY_IMPORT = {
    "rich",
    "tqdm",
    "slapshot.json_types",
    "slapshot.memory",
    "slapshot.text",
    "slapshot.whole_file",
    "pyarrow",
    "slapshot.parquet",
    "pydantic",
    "slapshot.yaml_file",
}
# Handlers that go on after anything, and note what it said: whatever an effect of anybody raises, and a
# figure that cannot be drawn. Nothing of the package that runs there raises InputError but of bad input.
NOTED = {
    "slapshot.diagnosis.diagnose",  # why a recording does not suffice: told, and no more
    "slapshot.diagnosis.pucks.report",
    "slapshot.diagnosis.pucks.launch.signatures",
    "slapshot.diagnosis.pucks.selection.trial",
    "slapshot.text",  # whose __str__ fails is called by its type
}


def module_names() -> Iterator[tuple[str, Path]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(("slapshot", *path.relative_to(PACKAGE).with_suffix("").parts))
        yield name.removesuffix(".__init__"), path


def everything_that_makes_results() -> dict[str, Path]:
    roots = {*(stage.module for stage in STAGES.values()), *FIGURES.values(), *CLAIMS.values()}
    scenes = {name for name, _ in module_names() if name.startswith("slapshot.scenes.")}
    effects = {name for name, _ in module_names() if name.startswith("slapshot.effects.")}
    return module_closure(*roots, *scenes, *effects)


def imports_of(path: Path) -> set[str]:
    """Everything that a file imports, `from a import b` as a.b."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "import_module":
            found |= {arg.value for arg in node.args if isinstance(arg, ast.Constant)}
    return found


def is_behind(name: str) -> bool:
    return any(f"{name}.".startswith(f"{module}.") for module in BEHIND)


def test_no_result_depends_on_what_shows_progress_and_keeps_results():
    """An unused line in progress.py made 110 of 115 versions of the tiny configuration anew."""
    for name in NEUTRAL:
        module, _, attribute = name.rpartition(".")
        assert is_behind(module)
        assert hasattr(import_module(module), attribute)
    taken = {
        imported
        for name, path in everything_that_makes_results().items()
        if not is_behind(name)
        for imported in imports_of(path)
    }
    assert {name for name in taken if is_behind(name)} <= NEUTRAL.keys()
    assert not {name for name in everything_that_makes_results() if is_behind(name)}


@pytest.mark.parametrize("name", [name for name, _ in module_names() if is_behind(name)])
def test_what_no_result_depends_on_computes_nothing_and_imports_nothing_that_does(name):
    path = find_source(name)
    assert path is not None
    may = MAY_IMPORT | ({"numpy", "pandas"} if name == "slapshot.store.verify" else set())
    for imported in imports_of(path):
        allowed = imported.split(".")[0] in sys.stdlib_module_names or is_behind(imported)
        allowed = allowed or any(f"{imported}.".startswith(f"{other}.") for other in may)
        assert allowed, f"{name} imports {imported}: does it still compute nothing?"


def test_an_input_error_ends_a_stage():
    """Its message may stay out of the digest only if no stage goes on and keeps it."""
    catching = set()
    for name, path in everything_that_makes_results().items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ExceptHandler):
                caught = "" if node.type is None else ast.unparse(node.type)
                wide = not caught or any(e in caught for e in ("InputError", "Exception", "BaseException"))
                goes_on = not isinstance(node.body[-1], ast.Raise)
                main = any("sys.stderr" in ast.unparse(statement) for statement in node.body)
                if wide and goes_on and not main:
                    catching.add(name)
    assert catching <= NOTED


def test_libraries_are_those_that_the_code_imports():
    assert "numba" in imported_libraries("slapshot.effects.slide_law")
    for stage in ("verdict", "diagnosis", "findings"):
        assert {"mujoco", "numba", "numpy", "scipy"} <= imported_libraries(STAGES[stage].module)
    assert imported_libraries("slapshot.store.lock", "slapshot.progress") == set()
    assert imported_libraries("slapshot.domains.fetchslide") >= {"gymnasium-robotics", "mujoco"}
    assert "torch" not in imported_libraries(STAGES["coverage"].module)
