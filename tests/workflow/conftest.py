"""A copy of the repository in which Snakemake runs the tiny configuration."""

import contextlib
import copy
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
COPIED = ("Snakefile", "workflow", "profiles", "config", "pipeline_src", "pyproject.toml", "data")
LONGEST = 600  # s, for one call; a call that hangs fails

_PLAN = """
import json, sys
from pathlib import Path
from slapshot.config import load_config
from slapshot.plan import ON_DEMAND, make_plan
recipes = make_plan(load_config(Path(sys.argv[1]))).recipes
asked = {label: r for label, r in recipes.items() if r.stage not in ON_DEMAND}
print(json.dumps({label: [r.stage, r.id, list(r.upstream.values())] for label, r in asked.items()}))
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

    def run(self, *command: str | Path, timeout: float = LONGEST) -> subprocess.CompletedProcess[str]:
        """A command in the copy; its output and errors come together."""
        return subprocess.run(
            command, cwd=self.root, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, check=False, timeout=timeout,
        )  # fmt: skip

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

    def content(self, version: Version) -> dict[str, str]:
        """File -> digest of its content."""
        return json.loads((self.folder(version) / "version.json").read_text())["content"]

    @property
    def published(self) -> Path:
        return self.root / "figures" / yaml.safe_load(self.config.read_text())["name"]

    def manifest(self) -> dict[str, str]:
        """Published file -> stage/id; the files that are there must be these."""
        manifest = json.loads((self.published / "versions.json").read_text())
        assert {p.name for p in self.published.iterdir()} == {*manifest, "versions.json"}
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

    def kill_when(self, condition: Callable[[], bool], *command: str) -> bool:
        """Start a command and kill it with all its children once the condition holds; False if it ended."""
        with (self.root / "killed.txt").open("w") as output:
            process = subprocess.Popen(
                command, cwd=self.root, env=self.environment, stdout=output, stderr=output,
                start_new_session=True,
            )  # fmt: skip
        latest = time.monotonic() + LONGEST
        while process.poll() is None and time.monotonic() < latest:
            if condition():
                break
            time.sleep(0.005)
        ended = process.poll() is not None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return not ended


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


@pytest.fixture(scope="session")
def can_render() -> bool:
    """Whether this machine has a GL library for the figures that show the scene."""
    code = (
        "from slapshot.figures.rendering import render\nimport mujoco\n"
        "model = mujoco.MjModel.from_xml_string("
        "'<mujoco><worldbody><camera name=\"c\"/></worldbody></mujoco>')\n"
        "data = mujoco.MjData(model)\nmujoco.mj_forward(model, data)\nrender(model, data, 'c', 32, 32)\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=False)
    return done.returncode == 0


@pytest.fixture(scope="session")
def new_workspace(tmp_path_factory, can_render) -> Callable[[str], Workspace]:
    """Makes a copy whose configuration is the tiny one, without what cannot be drawn here."""

    def make(name: str) -> Workspace:
        workspace = copy_repository(tmp_path_factory.mktemp(name))
        config = yaml.safe_load((ROOT / "config/tiny.yaml").read_text())
        default = yaml.safe_load((ROOT / "config/default.yaml").read_text())
        for key, domain in config["domains"].items():
            figures = domain.get("figures", default["domains"][key]["figures"])
            domain["figures"] = [f for f in figures if can_render or f != "F6"]
        workspace.config.write_text(yaml.safe_dump(config))
        return workspace

    return make


@pytest.fixture(scope="session")
def workspace(new_workspace) -> Workspace:
    """The copy in which everything has been made once."""
    workspace = new_workspace("workflow")
    workspace.snakemake("figures")
    return workspace
