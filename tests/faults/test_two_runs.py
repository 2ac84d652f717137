"""Two runs at once in one checkout: both end well, and nothing is made twice or damaged."""

import shutil

import pytest
from workspace import LONGEST, few, snakemake_command

pytestmark = pytest.mark.workflow


def test_two_runs_at_once_share_the_work(workspace, tmp_path):
    both = workspace.clone(tmp_path / "both")
    versions, before = both.plan(), both.whole()
    lost = few(versions, before)
    for label in lost:
        shutil.rmtree(both.folder(versions[label]))
    shutil.rmtree(both.published)

    command = snakemake_command("figures", config=both.config)
    outputs = [tmp_path / "first.txt", tmp_path / "second.txt"]
    runs = [both.start(*command, output=output) for output in outputs]
    codes = [run.wait(LONGEST) for run in runs]
    said = [output.read_text() for output in outputs]
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
