"""SIGKILL at any moment loses no finished version and leaves none that only looks whole."""

import random
import time

import pytest
from workspace import Version, Workspace, snakemake_command

pytestmark = pytest.mark.workflow

KILLS = 6
DELAYS = (2.0, 18.0)  # s; together they reach into most of a run, whose start takes two


@pytest.mark.parametrize("seed", [1])
def test_whenever_it_is_killed_it_goes_on_and_the_content_is_that_of_an_unbroken_run(
    workspace, new_workspace, seed
):
    """Another copy and store, killed twice in the rollouts and then at random, on one core or two."""
    other = new_workspace("killed")
    versions = other.plan()
    assert versions == workspace.plan()
    rng = random.Random(seed)
    shards = kill_in_the_rollouts(other, versions)
    kept = other.whole()
    for _ in range(KILLS):
        end = time.monotonic() + rng.uniform(*DELAYS)
        killed = other.kill_when(lambda end=end: time.monotonic() > end, *command(other, rng.choice([1, 2])))
        found = other.whole()
        assert {name: found.get(name) for name in kept} == kept
        kept = found
        if not killed:
            break

    done = other.run(*command(other, 2))
    assert done.returncode == 0, done.stdout
    found = other.whole()
    assert {name: found.get(name) for name in kept} == kept
    rollouts = of_stage(versions, "rollouts")
    log = (other.root / "logs/rollouts" / f"{rollouts.id}.log").read_text()
    assert not shards or f"rollouts/{rollouts.id}" in kept or "shards are there already" in log
    assert set(found) == {f"{v.stage}/{v.id}" for v in versions.values()}
    different = {
        label: sorted(name for name in workspace.content(v) if workspace.content(v)[name] != content[name])
        for label, v in versions.items()
        if (content := other.content(v)) != workspace.content(v)
    }
    assert different == {}
    assert other.manifest() == workspace.manifest()
    assert other.to_do() == {}
    assert not list((other.root / "data/store").glob("*/.partial-*"))


def kill_in_the_rollouts(other: Workspace, versions: dict[str, Version]) -> bool:
    """Kill a run as the rollouts begin, and one as their first shard is there; False if that one ended."""
    rollouts = of_stage(versions, "rollouts")
    folder = other.folder(rollouts)
    partial = folder.with_name(f".partial-{rollouts.id}")
    assert other.kill_when(partial.exists, *command(other, 1))
    assert not folder.exists()
    other.kill_when(lambda: any(partial.glob("parts/tracks-*.parquet")), *command(other, 1))
    return any(partial.glob("parts/tracks-*.parquet"))


def of_stage(versions: dict[str, Version], stage: str) -> Version:
    return next(version for version in versions.values() if version.stage == stage)


def command(other: Workspace, cores: int) -> tuple[str, ...]:
    return (*snakemake_command("figures", config=other.config), "--cores", str(cores))
