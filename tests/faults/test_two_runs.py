"""Two runs at once in one checkout: both end well, and nothing is made twice or damaged."""

import os
import shutil
from contextlib import ExitStack

import pytest
from slapshot.store.folder import Store
from workspace import few, snakemake_command

pytestmark = pytest.mark.workflow


def test_two_runs_at_once_share_the_work(workspace, tmp_path):
    both = workspace.clone(tmp_path / "both")
    versions, before = both.plan(), both.whole()
    lost = few(versions, before)
    for label in lost:
        shutil.rmtree(both.folder(versions[label]))
    shutil.rmtree(both.published)

    command = snakemake_command("figures", config=both.config)
    with (
        both.started(*command, output=tmp_path / "first.txt") as first,
        both.started(*command, output=tmp_path / "second.txt") as second,
    ):
        codes = [first.wait(), second.wait()]
    said = [first.said(), second.said()]
    assert codes == [0, 0], "\n".join(said)
    for label in lost:
        assert sum(text.count(f"{versions[label].id} made") for text in said) == 1

    after = both.whole()
    assert set(after) == set(before)
    kept = set(before) - {f"{versions[label].stage}/{versions[label].id}" for label in lost}
    assert {name: after[name] for name in kept} == {name: before[name] for name in kept}
    assert all(both.content(versions[label]) == workspace.content(versions[label]) for label in lost)
    both.snakemake("figures")
    assert both.whole() == after
    assert both.manifest() == workspace.manifest()
    assert both.to_do() == {}
    assert not list((both.root / "data/store").glob("*/.*"))


def test_a_run_leaves_alone_the_mark_of_what_another_has_made_since_it_began(workspace, tmp_path):
    """Without its mark the other run would miss what it has made, and after a while give up."""
    both = workspace.clone(tmp_path / "both")
    versions = both.plan()
    lost = few(versions, both.whole())
    first, second = [version for label, version in versions.items() if label in lost][:2]
    mark = both.mark(second)
    for version in (first, second):
        shutil.rmtree(both.folder(version))

    store = Store(both.root / "data/store")
    with ExitStack() as lock:
        lock.enter_context(store.locked(first.stage, first.id))
        command = snakemake_command("figures", config=both.config)
        with both.started(*command, output=tmp_path / "output.txt") as running:
            waiting = f"waiting for another process that makes {first.stage}/{first.id}"
            running.wait_until(lambda: waiting in running.said(), "it waits for the first version")
            shutil.copytree(workspace.folder(second), both.folder(second))
            mark.touch()
            os.link(mark, tmp_path / "mark")
            lock.close()
            assert running.wait() == 0, running.said()
    assert mark.samefile(tmp_path / "mark")
