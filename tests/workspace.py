"""A copy of the repository in which Snakemake runs the tiny configuration."""

import compileall
import contextlib
import json
import os
import py_compile
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from slapshot.config.files import load_config
from slapshot.dag import make_plan
from slapshot.store.folder import VERSION_FILE, Store
from slapshot.store.verify import damaged_files
from waiting import Command, started

ROOT = Path(__file__).parents[1]
COPIED = ("Snakefile", "workflow", "profiles", "config", "pipeline_src", "pyproject.toml", "data")

# Prints a plan before anything is edited, and one after each edit: pairs of a file and what it says then.
_PLANS = """
import json, sys
from pathlib import Path
from slapshot.config.files import load_config
from slapshot.dag import make_plan
def plan():
    recipes = make_plan(load_config(Path(sys.argv[1]))).of_figures()
    return {label: [r.stage, r.id, list(r.upstream.values())] for label, r in recipes.items()}
plans = []
for file, text in json.loads(sys.argv[2]):
    before = Path(file).read_text()
    Path(file).write_text(text)
    plans.append(plan())
    Path(file).write_text(before)
print(json.dumps(plans))
"""


@dataclass(frozen=True)
class Version:
    """A version that a configuration asks for."""

    stage: str
    id: str
    upstream: tuple[str, ...]  # stage/id


@dataclass
class Workspace:
    """A copy of the repository with a store of its own."""

    root: Path
    config: Path

    @property
    def environment(self) -> dict[str, str]:
        # Compiled files are those of copy_repository: by its time an edit within a second that keeps a file's
        # length would be overlooked.
        own = {"PYTHONPATH": str(self.root / "pipeline_src"), "PYTHONDONTWRITEBYTECODE": "1"}
        return {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"} | own

    def run(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        """A command in the copy; its output and errors come together."""
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder, "output.txt")
            with self.started(*command, output=output) as running:
                return subprocess.CompletedProcess(command, running.wait(), running.said())

    def python(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return self.run(sys.executable, *arguments)

    def snakemake(
        self, *targets: str, config: Path | None = None, good: bool = True
    ) -> subprocess.CompletedProcess[str]:
        """One call of snakemake; it must end well, or must not, as `good` says."""
        done = self.run(*snakemake_command(*targets, config=config or self.config))
        assert (done.returncode == 0) == good, done.stdout
        return done

    def to_do(self, config: Path | None = None) -> dict[str, int]:
        """Rule -> number of jobs that snakemake would run before it publishes, which it always does."""
        jobs = job_counts(self.snakemake("--dry-run", "figures", config=config).stdout)
        assert jobs.pop("figures") == 1
        return jobs

    def plan(self, config: Path | None = None) -> dict[str, Version]:
        """Label -> version of all that `figures` makes, by the code that the copy was made from."""
        with contextlib.chdir(self.root):
            recipes = make_plan(load_config(config or self.config)).of_figures()
        return {label: _version(r.stage, r.id, r.upstream.values()) for label, r in recipes.items()}

    def plans_after(
        self, *edits: tuple[str, Callable[[str], str]], config: Path | None = None
    ) -> list[dict[str, Version]]:
        """What `plan` would say after each edit alone of a source file, by the copy's own code."""
        changes = []
        for file, edit in edits:
            path = self.source(file)
            text = edit(path.read_text())
            assert text != path.read_text()
            changes.append((str(path), text))
        done = self.python("-c", _PLANS, config or self.config, json.dumps(changes))
        assert done.returncode == 0, done.stdout
        return [
            {label: _version(*version) for label, version in plan.items()} for plan in json.loads(done.stdout)
        ]

    def missing(self, versions: dict[str, Version]) -> set[str]:
        """Labels of versions that have not been made."""
        store = Store(self.root / "data/store")
        return {label for label, version in versions.items() if not store.is_whole(version.stage, version.id)}

    def variant(self, name: str, change: Callable[[dict[str, Any]], None]) -> Path:
        """A configuration that publishes where the first does, with something changed in its domain."""
        config = read_yaml(self.config)
        change(config["domains"]["hockey"])
        path = self.root / f"{name}.yaml"
        path.write_text(yaml.safe_dump(config))
        return path

    def source(self, file: str) -> Path:
        return self.root / "pipeline_src/slapshot" / file

    def folder(self, version: Version) -> Path:
        return self.root / "data/store" / version.stage / version.id

    def log(self, version: Version) -> Path:
        (file,) = (self.root / "logs" / version.stage).glob(f"*{version.id}.log")
        return file

    def mark(self, version: Version) -> Path:
        (file,) = (self.root / "data/marks" / version.stage).glob(f"*{version.id}")
        return file

    def whole(self) -> dict[str, tuple[int, int]]:
        """stage/id of all versions that the store calls whole -> what changes when one is made again.

        Each must have the content that its version.json states.
        """
        store = Store(self.root / "data/store")
        found = {}
        for folder, _ in store.versions():
            if store.is_whole(folder.parent.name, folder.name):
                assert damaged_files(folder) == []
                stat = (folder / VERSION_FILE).stat()
                found[f"{folder.parent.name}/{folder.name}"] = (stat.st_ino, stat.st_mtime_ns)
        return found

    def content(self, version: Version) -> dict[str, str]:
        """File -> digest of its content."""
        return json.loads((self.folder(version) / "version.json").read_text())["content"]

    @property
    def published(self) -> Path:
        return self.root / "figures" / read_yaml(self.config)["name"]

    def manifest(self) -> dict[str, str]:
        """Published file -> stage/id; the files that are there must be these."""
        manifest = json.loads((self.published / "versions.json").read_text())
        files = {str(p.relative_to(self.published)) for p in self.published.rglob("*") if p.is_file()}
        assert files == {*manifest, "versions.json"}
        return manifest

    @contextlib.contextmanager
    def edited(self, file: str, edit: Callable[[str], str]) -> Iterator[None]:
        """A source file of the copy, changed for a while."""
        path = self.source(file)
        before = path.read_text()
        after = edit(before)
        assert after != before
        try:
            path.write_text(after)
            yield
        finally:
            path.write_text(before)

    def started(self, *command: str | Path, output: Path) -> contextlib.AbstractContextManager[Command]:
        """A command that runs in the copy, and is killed with all its children when the block ends."""
        return started(*command, output=output, cwd=self.root, env=self.environment)

    def kill_when(self, condition: Callable[[], bool], *command: str) -> bool:
        """Start a command and kill it with all its children once the condition holds; False if it ended."""
        with self.started(*command, output=self.root / "killed.txt") as running:
            running.wait_until(lambda: condition() or not running.runs(), "it may be killed")
            return running.runs()

    def clone(self, folder: Path) -> "Workspace":
        """Another copy with all that has been made in this one."""
        shutil.copytree(self.root, folder, symlinks=True)
        return Workspace(folder, folder / self.config.name)


def _version(stage: str, version_id: str, upstream: Iterable[Iterable[str]]) -> Version:
    return Version(stage, version_id, tuple("/".join(pair) for pair in upstream))


def upstream(versions: dict[str, Version], labels: Collection[str]) -> dict[str, Version]:
    """The versions with these labels and all that they are made from."""
    needed = {f"{versions[label].stage}/{versions[label].id}" for label in labels}
    found = {}
    for label, version in reversed(versions.items()):  # upstream comes first
        if f"{version.stage}/{version.id}" in needed:
            needed.update(version.upstream)
            found[label] = version
    return found


def downstream(versions: dict[str, Version], labels: set[str]) -> set[str]:
    """The labels and those of all versions that are made from theirs."""
    found = set(labels)
    for label, version in versions.items():  # upstream comes first
        if set(version.upstream) & {f"{versions[other].stage}/{versions[other].id}" for other in found}:
            found.add(label)
    return found


def few(versions: dict[str, Version], made: Collection[str]) -> set[str]:
    """Labels of one version and all that is made from it: few of them, of many stages."""
    families = [downstream(versions, {label}) for label in versions]
    families = [{n for n in family if f"{versions[n].stage}/{versions[n].id}" in made} for family in families]
    small = [family for family in families if 0 < len(family) <= 5]
    return max(small, key=lambda family: (len({versions[n].stage for n in family}), sorted(family)))


def read_yaml(path: Path) -> dict[str, Any]:
    """A configuration, by the parser in C: the other takes half a second."""
    return yaml.load(path.read_text(), Loader=yaml.CSafeLoader)


def snakemake_command(*targets: str, config: Path) -> tuple[str, ...]:
    return (sys.executable, "-m", "snakemake", *targets, "--configfile", str(config))


def job_counts(output: str) -> dict[str, int]:
    """Rule -> jobs, from the first table that snakemake prints, without the copies for the report."""
    if "Nothing to be done" in output:
        return {}
    table = re.search(r"^job +count\n[- ]+\n(.*?)^total ", output, re.DOTALL | re.MULTILINE)
    assert table, output
    counts = re.findall(r"^(\w+) +(\d+)$", table[1], re.MULTILINE)
    return {rule: int(count) for rule, count in counts if not rule.startswith("report_")}


def copy_repository(folder: Path) -> Workspace:
    """What git tracks or would track of the parts that the workflow needs."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z", "--", *COPIED],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    # Hundreds of processes start in a copy. A hash tells them which files were edited since.
    compileall.compile_dir(
        folder / "pipeline_src", quiet=2, invalidation_mode=py_compile.PycInvalidationMode.CHECKED_HASH
    )
    return Workspace(folder, folder / "test.yaml")
