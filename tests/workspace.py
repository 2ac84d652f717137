"""A copy of the repository in which Snakemake runs the tiny configuration."""

import contextlib
import copy
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from slapshot.store.folder import VERSION_FILE, Store
from slapshot.store.verify import damaged_files
from waiting import Command, started

ROOT = Path(__file__).parents[1]
COPIED = ("Snakefile", "workflow", "profiles", "config", "pipeline_src", "pyproject.toml", "data")

_PLAN = """
import json, sys
from pathlib import Path
from slapshot.config.files import load_config
from slapshot.dag import make_plan
recipes = make_plan(load_config(Path(sys.argv[1]))).of_figures()
print(json.dumps({label: [r.stage, r.id, list(r.upstream.values())] for label, r in recipes.items()}))
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
        # No compiled files: an edit within the second that keeps a file's length would be overlooked.
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
        """Label -> version of all that `figures` makes, by the copy's own code."""
        done = self.python("-c", _PLAN, config or self.config)
        assert done.returncode == 0, done.stdout
        return {
            label: Version(stage, version_id, tuple("/".join(pair) for pair in upstream))
            for label, (stage, version_id, upstream) in json.loads(done.stdout).items()
        }

    def variant(self, name: str, change: Callable[[dict[str, Any]], None]) -> Path:
        """A configuration that publishes where the first does, with something changed in its domain."""
        config = copy.deepcopy(yaml.safe_load(self.config.read_text()))
        change(config["domains"]["hockey"])
        path = self.root / f"{name}.yaml"
        path.write_text(yaml.safe_dump(config))
        return path

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
        return self.root / "figures" / yaml.safe_load(self.config.read_text())["name"]

    def manifest(self) -> dict[str, str]:
        """Published file -> stage/id; the files that are there must be these."""
        manifest = json.loads((self.published / "versions.json").read_text())
        files = {str(p.relative_to(self.published)) for p in self.published.rglob("*") if p.is_file()}
        assert files == {*manifest, "versions.json"}
        return manifest

    @contextlib.contextmanager
    def edited(self, file: str, edit: Callable[[str], str]) -> Iterator[None]:
        """A source file of the copy, changed for a while."""
        path = self.root / "pipeline_src/slapshot" / file
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
    return Workspace(folder, folder / "test.yaml")
