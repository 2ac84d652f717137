"""Publishing: only what is whole, and nothing stale beside it."""

import errno
import json
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from slapshot.errors import InputError
from slapshot.publish import MANIFEST, SMALL_PROOF, publish
from slapshot.publish_version import publish_version
from slapshot.store.folder import Store
from slapshot.store.lock import held
from slapshot.store.recipe import Recipe
from waiting import join, wait_until


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "data/store")


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "figures"


def put(store: Store, stage: str, number: int = 0, /, **files: str) -> str:
    """A version with some files (underscores for the first dash and the last dot); its stage/id."""
    recipe = Recipe(stage, {"number": number}, code="0" * 64)
    with store.new_version(recipe) as out:
        for name, text in files.items():
            (out / name.replace("_", "-", 1).replace("_", ".")).write_text(text)
    return f"{stage}/{recipe.id}"


def f7(store: Store, number: int, text: str = "old") -> str:
    return put(store, "figure", number, F7_simulated_png=text, F7_simulated_csv=text)


def remove(store: Store, version: str) -> None:
    folder = store.root / version
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()


def published(target: Path) -> dict[str, str]:
    return {p.name: p.read_text() for p in target.iterdir() if p.is_file() and p.name != MANIFEST}


def test_files_of_figures_are_copied_and_the_manifest_says_where_from(store, target):
    figure, table = f7(store, 1), put(store, "figure", 2, T2_list_csv="t", notes="not a figure")
    publish(store, [put(store, "train", model="weights"), figure, table], target)
    assert published(target) == {"F7-simulated.png": "old", "F7-simulated.csv": "old", "T2-list.csv": "t"}
    assert json.loads((target / MANIFEST).read_text()) == {
        "F7-simulated.png": figure, "F7-simulated.csv": figure, "T2-list.csv": table,
    }  # fmt: skip


def test_the_small_proof_has_a_folder_of_its_own(store, target):
    first = put(store, "score", 1, proof_page_md="told", P1_confusion_png="seen")
    publish(store, [first], target)
    folder = target / SMALL_PROOF
    assert sorted(p.name for p in folder.iterdir()) == ["P1-confusion.png", "proof-page.md"]
    publish(store, [put(store, "score", 2, proof_page_md="told anew")], target)
    assert [p.name for p in folder.iterdir()] == ["proof-page.md"]
    assert (folder / "proof-page.md").read_text() == "told anew"


def test_a_proof_leaves_the_measures_of_other_labs(store, target):
    head = "lab,measure,condition,value,low,high,n\n"
    first, joints = "first,in_class,plain,0.9,0.8,1,53\n", "joints,in_class,single,0.8,0.7,0.9,110\n"
    recipe = Recipe("joint_score", {"number": 1}, code="0" * 64)
    with store.new_version(recipe) as out:
        for name, text in (("proof.csv", head + joints), ("page.md", "told"), ("cases.csv", "case\n")):
            (out / name).write_text(text)
    target.mkdir()
    (target / "proof.csv").write_text(head + first + joints.replace("0.8", "0.5"))
    folder = store.folder("joint_score", recipe.id)
    publish_version(folder, target, "proof-joints", beside=["page.md"], measures="proof.csv")
    assert published(target) == {"proof.csv": head + first + joints, "page.md": "told"}
    assert {p.name for p in (target / "proof-joints").iterdir()} == {"cases.csv", "versions.json"}


def test_publishing_again_changes_no_file(store, target):
    versions = [f7(store, 1)]
    publish(store, versions, target)
    before = {p.name: p.stat().st_mtime_ns for p in target.glob("F*")}
    publish(store, versions, target)
    assert {p.name: p.stat().st_mtime_ns for p in target.glob("F*")} == before


def test_what_is_stale_is_replaced_or_removed_and_other_files_stay(store, target):
    publish(store, [f7(store, 1), put(store, "figure", 2, F10_more_png="ten", T2_list_csv="t")], target)
    (target / "F7-by-hand.png").write_text("of nobody")
    (target / "benchmark.csv").write_text("measured")
    (target / "Figure.png").write_text("mine")
    (target / "tiny").mkdir()
    (target / "F1-folder").mkdir()
    publish(store, [f7(store, 3, "new")], target)
    assert published(target) == {
        "F7-simulated.png": "new",
        "F7-simulated.csv": "new",
        "benchmark.csv": "measured",
        "Figure.png": "mine",
    }
    assert (target / "tiny").is_dir()
    assert (target / "F1-folder").is_dir()


@pytest.mark.parametrize("stage", ["figure", "train"])
def test_a_missing_version_stops_publishing_before_anything_is_written(store, target, stage):
    missing = put(store, stage, 1, F7_simulated_png="x")
    remove(store, missing)
    with pytest.raises(InputError, match=f"{missing} is missing: run `snakemake figures`"):
        publish(store, [f7(store, 2), missing], target)
    assert not target.exists()


@pytest.mark.parametrize("available", [False, True])
def test_a_damaged_payload_is_named_and_nothing_is_published(store, target, available):
    data = put(store, "train", 1, model="weights")
    (store.root / data / "model").write_text("weightz")
    with pytest.raises(InputError) as caught:
        publish(store, [data, f7(store, 1)], target, available)
    message = str(caught.value)
    assert f"{data}/model is not what was written there; run `slapshot versions verify --repair`" in message
    assert message.endswith("removes it and all that was made from it, then make them again")
    assert "\n" not in message
    assert not target.exists()


def test_what_is_available_is_published_although_something_is_missing(store, target):
    missing = put(store, "figure", 2, T2_list_csv="t")
    remove(store, missing)
    publish(store, [f7(store, 1), missing], target, available=True)
    assert set(published(target)) == {"F7-simulated.png", "F7-simulated.csv"}


def test_available_keeps_what_is_of_the_missing_version_and_removes_what_is_of_another(store, target):
    kept, stale = put(store, "figure", 2, T2_list_csv="t"), f7(store, 1)
    publish(store, [kept, stale], target)
    wanted = f7(store, 3, "new")
    remove(store, kept)
    remove(store, wanted)
    for _ in range(2):  # a second failure must not forget what the first kept
        publish(store, [kept, wanted], target, available=True)
        assert published(target) == {"T2-list.csv": "t"}
        assert json.loads((target / MANIFEST).read_text()) == {"T2-list.csv": kept}


def test_without_a_manifest_nothing_published_before_is_trusted(store, target):
    missing = f7(store, 1)
    publish(store, [missing], target)
    (target / MANIFEST).unlink()
    remove(store, missing)
    publish(store, [missing], target, available=True)
    assert published(target) == {}


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "slapshot.publish", *arguments],
        cwd=folder, capture_output=True, text=True, check=False, env=os.environ | {"MUJOCO_GL": "disable"},
    )  # fmt: skip


def test_the_default_configuration_publishes_to_figures_and_others_beside_it(store, tmp_path):
    version = f7(store, 1)
    for name, folder in (("default", "figures"), ("my-own", "figures/my-own")):
        assert command(tmp_path, "--name", name, "--log", "logs/publish.log", version).returncode == 0
        assert (tmp_path / folder / "F7-simulated.png").is_file()
    assert "2 files in figures/my-own" in (tmp_path / "logs/publish.log").read_text()


def test_the_command_says_in_one_line_what_is_missing(tmp_path):
    done = command(tmp_path, "--name", "default", "figure/0123456789ab")
    assert done.returncode == 1
    assert done.stderr == "[figures] data/store/figure/0123456789ab is missing: run `snakemake figures`\n"
    assert not (tmp_path / "figures").exists()


def test_a_full_disk_is_one_line_and_what_was_published_stays_whole(store, target, monkeypatch):
    publish(store, [f7(store, 1)], target)
    before = published(target)

    def full(source: Path, copy: Path) -> None:
        copy.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device", str(copy))

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfile", full)
        with pytest.raises(InputError) as caught:
            publish(store, [f7(store, 2, "new")], target)
    message = str(caught.value)
    assert message.startswith(f"{target} could not be written: No space left on device ({target}/.F7-")
    assert "\n" not in message
    assert {name: text for name, text in published(target).items() if name[0] != "."} == before
    publish(store, [f7(store, 1)], target)
    assert published(target) == before  # the half copy is gone, too


def test_who_publishes_waits_for_who_publishes_to_the_same_folder(store, target, caplog):
    caplog.set_level("INFO", "slapshot")
    version = f7(store, 1)
    target.mkdir()
    with held(target / ".lock", "publishes"):
        thread = threading.Thread(target=publish, args=(store, [version], target), daemon=True)
        thread.start()
        waiting = f"waiting for another process that publishes to {target}"
        wait_until(lambda: waiting in caplog.messages, "it waits", thread.is_alive)
        assert published(target).keys() == {".lock"}
    join(thread)
    assert set(published(target)) == {"F7-simulated.png", "F7-simulated.csv"}
