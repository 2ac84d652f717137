"""SIGKILL at any moment loses no finished version and leaves none that only looks whole."""

import os
import random
import shutil
from collections.abc import Callable

import pytest
from workspace import Version, Workspace, job_counts, snakemake_command, upstream

pytestmark = pytest.mark.workflow

KILLS = 3
CHANGES = (1, 30)  # of the store, before a kill


# Of few stages, and of all, with what a target makes of them.
FEW = ("figures_hockey", {"F9", "T2", "U2"})
ALL = ("figures", None)


@pytest.mark.parametrize("seed", [1])
@pytest.mark.parametrize(("target", "figures"), [FEW, pytest.param(*ALL, marks=pytest.mark.slow)])
def test_whenever_it_is_killed_it_goes_on_and_the_content_is_that_of_an_unbroken_run(
    workspace, tmp_path, target, figures, seed
):
    """A copy with an empty store, killed twice in the rollouts and then at random, on one core or two."""
    other = emptied(workspace.clone(tmp_path / "killed"))
    if figures is not None:
        other.config = other.variant("few", lambda domain: domain.update(figures=sorted(figures)))
    versions = other.plan()
    if figures is not None:
        versions = upstream(versions, {f"figure/hockey/{figure}" for figure in figures})
    unbroken = workspace.plan()
    assert versions.items() <= unbroken.items()
    rng = random.Random(seed)
    kill_as_a_version_is_finished(other, versions, target)
    shards = kill_in_the_rollouts(other, versions, target)
    kept = other.whole()
    for _ in range(KILLS):
        changes = rng.randint(*CHANGES)
        killed = other.kill_when(changed(other, changes), *command(other, target, rng.choice([1, 2])))
        found = other.whole()
        assert {name: found.get(name) for name in kept} == kept
        kept = found
        if not killed:
            break

    done = other.run(*command(other, target, 2))
    assert done.returncode == 0, done.stdout
    found = other.whole()
    assert {name: found.get(name) for name in kept} == kept
    rollouts = of_stage(versions, "rollouts")
    log = other.log(rollouts).read_text()
    assert not shards or f"rollouts/{rollouts.id}" in kept or "shards are there already" in log
    assert set(found) == {f"{v.stage}/{v.id}" for v in versions.values()}, done.stdout
    different = {
        label: sorted(name for name in workspace.content(v) if workspace.content(v)[name] != content[name])
        for label, v in versions.items()
        if (content := other.content(v)) != workspace.content(v)
    }
    assert different == {}
    published = {name: version for name, version in workspace.manifest().items() if version in found}
    assert other.manifest() == published
    assert published
    assert job_counts(other.snakemake("--dry-run", target).stdout) == {target: 1}
    assert not list((other.root / "data/store").glob("*/.partial-*"))


def emptied(made: Workspace) -> Workspace:
    """As it was before anything was made; compiled functions stay."""
    for folder in ("data/store", "data/marks", "data/report", "logs", "figures", ".snakemake"):
        shutil.rmtree(made.root / folder)
    return made


def kill_as_a_version_is_finished(other: Workspace, versions: dict[str, Version], target: str) -> None:
    """Before Snakemake hears of it: nothing but that version is missing in what it would do then."""
    first = of_stage(versions, "swings")
    assert other.kill_when(lambda: other.folder(first).exists(), *command(other, target, 1))
    jobs = job_counts(other.snakemake("--dry-run", target).stdout)
    assert sum(jobs.values()) == len(versions) - len(other.whole()) + 1
    assert jobs[target] == 1


def kill_in_the_rollouts(other: Workspace, versions: dict[str, Version], target: str) -> bool:
    """Kill a run as the rollouts begin, and one as their first shard is there; False if that one ended."""
    rollouts = of_stage(versions, "rollouts")
    folder = other.folder(rollouts)
    partial = folder.with_name(f".partial-{rollouts.id}")
    other.kill_when(lambda: partial.exists() or folder.exists(), *command(other, target, 1))
    while not partial.exists():
        assert folder.exists(), (other.root / "killed.txt").read_text()
        shutil.rmtree(folder)  # they were made before anybody looked: once more
        other.kill_when(lambda: partial.exists() or folder.exists(), *command(other, target, 1))
    other.kill_when(lambda: any(partial.glob("parts/tracks-*.parquet")), *command(other, target, 1))
    return any(partial.glob("parts/tracks-*.parquet"))


def changed(other: Workspace, times: int) -> Callable[[], bool]:
    """A condition that holds once files of the store have come or gone so many times."""
    seen, left = files_of_store(other), times

    def condition() -> bool:
        nonlocal seen, left
        before, seen = seen, files_of_store(other)
        left -= seen != before
        return left <= 0

    return condition


def files_of_store(other: Workspace) -> set[str]:
    walk = os.walk(other.root / "data/store")  # which does not mind that folders go meanwhile
    return {f"{folder}/{name}" for folder, _, names in walk for name in names}


def of_stage(versions: dict[str, Version], stage: str) -> Version:
    return next(version for version in versions.values() if version.stage == stage)


def command(other: Workspace, target: str, cores: int) -> tuple[str, ...]:
    return (*snakemake_command(target, config=other.config), "--cores", str(cores))
