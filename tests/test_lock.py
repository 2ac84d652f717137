"""The lock: all that pyproject.toml asks for, at one version, with hashes, and no address of an index."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LOCKS = {file.name: file.read_text() for file in sorted((ROOT / "requirements").glob("*.txt"))}


def packages(text: str) -> dict[str, str]:
    """Normal name of a package -> its lines."""
    blocks = re.split(r"^(?=\w)", text, flags=re.MULTILINE)[1:]
    return {normal(re.split("==", block)[0]): block for block in blocks}


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", re.split(r"[\[><=]", name)[0]).lower()


def test_there_are_the_files_that_the_makefile_installs():
    named = set(re.findall(r"requirements/([\w-]+\.txt)", (ROOT / "Makefile").read_text()))
    assert named == {"build.txt", "cuda.txt", "docs.txt", "lock.txt", "torch-cpu.txt"}
    assert set(LOCKS) == named | {"benchmark.txt", "slurm.txt"}


@pytest.mark.parametrize("name", LOCKS)
def test_every_package_has_one_version_and_hashes(name):
    for block in packages(LOCKS[name]).values():
        first, *hashes = block.splitlines()
        assert re.match(r"[\w.-]+==[\w.+]+( ; .*)? \\$", first), first
        assert hashes
        assert all(re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}( \\)?", line) for line in hashes), first
    assert not re.search(r"https?:|file:|--(extra-)?index|--find-links|@", LOCKS[name])


def test_what_the_project_asks_for_is_locked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    assert {normal(name) for name in asked} <= set(packages(LOCKS["lock.txt"]))
    assert set(packages(LOCKS["build.txt"])) == {"pip", "setuptools"}


def test_no_package_is_locked_twice_and_cuda_is_no_requirement():
    names = [name for file, text in LOCKS.items() if file != "torch-cpu.txt" for name in packages(text)]
    assert len(names) == len(set(names))
    cuda = {name for name in names if name.startswith(("nvidia-", "cuda-")) or name == "triton"}
    assert cuda == set(packages(LOCKS["cuda.txt"]))


def test_both_builds_of_torch_are_of_one_version():
    (version,) = re.findall(r"^torch==(\S+)", LOCKS["lock.txt"], flags=re.MULTILINE)
    (local,) = packages(LOCKS["torch-cpu.txt"])
    assert packages(LOCKS["torch-cpu.txt"])[local].startswith(f"torch=={version}+cpu ")
