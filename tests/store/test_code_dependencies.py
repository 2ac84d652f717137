"""What counts as a stage's code: the closure of its imports, read as syntax trees."""

import itertools
import os
import shutil
from pathlib import Path

import pytest
from slapshot.dag import FIGURES, STAGES
from slapshot.errors import InputError
from slapshot.store.code_dependencies import code_digest, find_source, imported_libraries, module_closure

SOURCES = {
    "__init__.py": '"""A package."""\n',
    "base.py": "def twice(x):\n    return 2 * x\n",
    "middle.py": (
        '"""Between."""\nfrom PKG.base import twice\n\n\n'
        'class Four:\n    """Docstring."""\n\n'
        '    def times(self, x, label="a"):\n        """Docstring."""\n        return twice(twice(x))\n'
    ),
    "stage.py": "from PKG import middle\n\nRESULT = middle.Four\n",
    "other.py": "import json\n\nVALUE = 1\n",
    "late.py": "def late():\n    from PKG import other\n\n    return other.VALUE\n",
    "typed.py": (
        "from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    import PKG.other as o\n\nX: 'o' = 1\n"
    ),
    "alone.py": "X = 1\n",
    "relative.py": "from .sub import inner\n\nY = inner.Z\n",
    "sub/__init__.py": "from . import inner\n",
    "sub/inner.py": "from ..base import twice\n\nZ = twice\n",
    "sub/model.xml": "<model/>",
    "sub/deep/__init__.py": "",
    "sub/deep/leaf.py": "LEAF = 1\n",
}
MODULES = [
    "base", "middle", "stage", "other", "late", "typed", "alone", "relative",
    "sub", "sub.inner", "sub.deep.leaf",
]  # fmt: skip
_numbers = itertools.count()


class Package:
    """A package on the path. Its name is new each time: imports of a name are looked up once a process."""

    def __init__(self, folder: Path) -> None:
        self.name = f"closure_example_{next(_numbers)}"
        self.folder = folder / self.name
        self._time = 10**18
        for path, text in SOURCES.items():
            self.write(path, text)

    def write(self, path: str, text: str) -> None:
        file = self.folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text.replace("PKG", self.name))
        self._time += 1  # digests are kept by file and time, and the clock of a file system is coarse
        os.utime(file, ns=(self._time, self._time))

    def edit(self, path: str, old: str, new: str) -> None:
        text = (self.folder / path).read_text()
        old = old.replace("PKG", self.name)
        assert text.count(old) == 1
        self.write(path, text.replace(old, new))

    def digests(self) -> dict[str, str]:
        return {name: code_digest(f"{self.name}.{name}") for name in MODULES}

    def closure(self, *names: str) -> set[str]:
        found = module_closure(*(f"{self.name}.{name}" for name in names))
        return {name.removeprefix(self.name).removeprefix(".") for name in found}


@pytest.fixture
def package(tmp_path, monkeypatch) -> Package:
    monkeypatch.syspath_prepend(tmp_path)
    return Package(tmp_path)


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    return {name for name in before if before[name] != after[name]}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["base"], {"", "base"}),
        (["stage"], {"", "stage", "middle", "base"}),
        (["late"], {"", "late", "other"}),
        (["typed"], {"", "typed"}),
        (["relative"], {"", "relative", "sub", "sub.inner", "base"}),
        (["sub"], {"", "sub", "sub.inner", "base"}),
        (["sub.deep.leaf"], {"", "sub", "sub.deep", "sub.deep.leaf", "sub.inner", "base"}),
        (["alone", "other"], {"", "alone", "other"}),
    ],
)
def test_closure_is_what_a_module_imports_and_the_packages_it_lies_in(package, names, expected):
    assert package.closure(*names) == expected


USES_BASE = {"base", "middle", "stage", "relative", "sub", "sub.inner", "sub.deep.leaf"}
USES_SUB = {"relative", "sub", "sub.inner", "sub.deep.leaf"}


@pytest.mark.parametrize(
    ("path", "old", "new", "expected"),
    [
        ("base.py", "2 * x", "3 * x", USES_BASE),
        ("base.py", "    return", "    pass\n    return", USES_BASE),
        ("middle.py", "twice(twice(x))", "twice(x)", {"middle", "stage"}),
        ("middle.py", 'label="a"', 'label="b"', {"middle", "stage"}),
        ("other.py", "VALUE = 1", "VALUE = 1.0", {"other", "late"}),
        ("alone.py", "X = 1", "X = 2", {"alone"}),
        ("sub/inner.py", "Z = twice", "Z = twice(1)", USES_SUB),
        ("sub/__init__.py", "from . import inner", "from . import inner\nA = 1", USES_SUB),
        ("sub/deep/leaf.py", "LEAF = 1", "LEAF = 2", {"sub.deep.leaf"}),
        ("sub/model.xml", "<model/>", "<model />", USES_SUB),
        ("__init__.py", '"""A package."""', '"""A package."""\nA = 1', set(MODULES)),
    ],
)
def test_a_code_edit_changes_what_imports_it_and_nothing_else(package, path, old, new, expected):
    before = package.digests()
    package.edit(path, old, new)
    assert changed(before, package.digests()) == expected


@pytest.mark.parametrize(
    ("path", "old", "new"),
    [
        ("base.py", "def twice", "# A comment.\ndef twice"),
        ("base.py", "2 * x", "2 * x  # a comment"),
        ("base.py", "def twice(x):\n", "\n\n\ndef twice(x):\n\n"),
        ("base.py", "2 * x", "(2 * x)"),
        ("base.py", "return 2 * x", "return (\n        2\n        * x\n    )"),
        ("base.py", "(x):\n", '(x):\n    """A new docstring."""\n'),
        ("base.py", "def twice", '"""A new docstring."""\n\n\ndef twice'),
        ("middle.py", 'label="a"', "label='a'"),
        ("middle.py", '        """Docstring."""\n', '        """Another\n\n        one."""\n'),
        ("middle.py", '        """Docstring."""\n', ""),
        ("middle.py", ':\n    """Docstring."""', ':\n    """Another."""'),
        ("middle.py", '"""Between."""', '"""In between."""'),
        ("sub/deep/__init__.py", "", '"""A docstring where nothing was."""'),
        ("__init__.py", '"""A package."""\n', ""),
    ],
)
def test_comments_docstrings_and_layout_do_not_count(package, path, old, new):
    before = package.digests()
    if old:
        package.edit(path, old, new)
    else:
        package.write(path, new)
    assert changed(before, package.digests()) == set()


def test_an_edit_taken_back_gives_the_old_digest(package):
    before = package.digests()
    package.edit("base.py", "2 * x", "3 * x")
    package.edit("base.py", "3 * x", "2 * x")
    assert package.digests() == before


def test_a_body_of_nothing_but_a_docstring_keeps_its_syntax(package):
    package.write("alone.py", 'def empty():\n    """Only this."""\n\n\nclass Empty:\n    """And this."""\n')
    first = package.digests()["alone"]
    package.write("alone.py", "def empty():\n    pass\n\n\nclass Empty:\n    pass\n")
    assert package.digests()["alone"] == first


def test_a_new_data_file_counts_by_name_and_bytes_and_what_editors_leave_does_not(package):
    before = package.digests()
    package.write("sub/.model.xml.swp", "editor")
    package.write("sub/model.xml~", "backup")
    (package.folder / "sub/__pycache__").mkdir()
    package.write("sub/__pycache__/inner.cpython-311.pyc", "compiled")
    assert changed(before, package.digests()) == set()
    package.write("sub/second.xml", "<model/>")
    added = package.digests()
    assert changed(before, added) == USES_SUB
    shutil.move(package.folder / "sub/second.xml", package.folder / "sub/third.xml")
    assert changed(added, package.digests()) == USES_SUB


def test_a_module_from_outside_the_package_is_brought_in(package):
    """A domain of one's own: registered beside a stage of slapshot, it brings what it imports."""
    package.write("domain.py", "from slapshot.parquet import read_table\nfrom PKG import other\n")
    modules = ("slapshot.errors", f"{package.name}.domain")
    assert set(module_closure(*modules)) == {
        "slapshot", "slapshot.errors", "slapshot.parquet", "slapshot.text",
        package.name, f"{package.name}.domain", f"{package.name}.other",
    }  # fmt: skip
    before, alone = code_digest(*modules), code_digest("slapshot.errors")
    package.edit("other.py", "VALUE = 1", "VALUE = 2")
    assert code_digest(*modules) != before
    assert code_digest("slapshot.errors") == alone


def test_a_module_alone_on_the_path(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    name = f"closure_example_{next(_numbers)}"
    (tmp_path / f"{name}.py").write_text("import slapshot.errors\n")
    assert set(module_closure(name)) == {name, "slapshot", "slapshot.errors", "slapshot.text"}
    (tmp_path / f"{name}_2.py").write_text("from slapshot.errors import InputError\n")
    assert set(module_closure(f"{name}_2")) == {f"{name}_2"}


def test_a_module_beside_ones_own_counts_and_libraries_are_named(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    name, helper = (f"closure_example_{next(_numbers)}" for _ in range(2))
    (tmp_path / f"{name}.py").write_text(f"import json\nimport {helper}\nimport no_such_library\n")
    (tmp_path / f"{helper}.py").write_text("import numba\nimport yaml\nimport tqdm, rich.table\n")
    (tmp_path / "compiled.so").write_text("")
    assert set(module_closure(name)) == {name, helper}
    before = code_digest(name)
    assert imported_libraries(name) == {"numba", "pyyaml"}
    (tmp_path / f"{helper}.py").write_text("X = 1\n")
    assert code_digest(name) != before
    assert imported_libraries(name) == set()


def test_a_package_wins_over_a_module_of_the_same_name_as_in_python(package):
    package.write("sub.py", "SHADOWED = True\n")
    assert find_source(f"{package.name}.sub") == package.folder / "sub" / "__init__.py"


@pytest.mark.parametrize(
    "name",
    ["slapshot.nowhere", "nowhere_at_all.module", "slapshot.store.recipe.make_recipe", "slapshot.scenes.",
     "slapshot/errors", ".", "", "slapshot.scenes.../errors"],
)  # fmt: skip
def test_a_missing_module_is_refused(name):
    with pytest.raises(ModuleNotFoundError, match="no module"):
        code_digest("slapshot.errors", name)


def test_a_syntax_error_is_an_input_error_with_file_and_line(package):
    package.edit("base.py", "return 2 * x", "return 2 *")
    with pytest.raises(InputError, match=r"base\.py:2: not valid Python .*mend that line"):
        code_digest(f"{package.name}.stage")


@pytest.mark.parametrize("module", sorted({*(stage.module for stage in STAGES.values()), *FIGURES.values()}))
def test_no_result_depends_on_planning_and_publishing(module):
    """Otherwise a new rule or a better message would run everything again."""
    if find_source(module) is None:
        pytest.skip(f"{module} is not written yet")
    whole = ("config.files", "config.configuration", "config.domain")
    tools = {f"slapshot.{name}" for name in (*whole, "dag", "cli", "publish", "store.verify")}
    assert not tools & set(module_closure(module))
