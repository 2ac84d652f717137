"""Versions that are packed on one machine and unpacked on another."""

import tarfile
from pathlib import Path

import pytest
from slapshot.errors import InputError
from slapshot.store.archive import pack, unpack
from slapshot.store.folder import Store
from slapshot.store.version_file import damaged_files


@pytest.fixture
def other(tmp_path: Path) -> Store:
    return Store(tmp_path / "elsewhere" / "store")


def test_versions_arrive_whole(store, make, other, tmp_path):
    first, second = make("train", {"n": 1}, weights=b"x" * 1000), make("evaluate", {"n": 2})
    file = tmp_path / "versions.tar.xz"
    assert sorted(pack(store, file)) == sorted([f"train/{first.id}", f"evaluate/{second.id}"])
    assert sorted(unpack(other, file)) == sorted([f"train/{first.id}", f"evaluate/{second.id}"])
    for recipe in (first, second):
        assert damaged_files(other.folder(recipe.stage, recipe.id)) == []
    assert (other.folder("train", first.id) / "weights").read_bytes() == b"x" * 1000
    other.check_mark()
    assert not list(other.root.glob(".unpacking-*"))


def test_of_some_stages_alone(store, make, other, tmp_path):
    first = make("train", {"n": 1})
    make("evaluate", {"n": 2})
    file = tmp_path / "versions.tar.xz"
    assert pack(store, file, ["train"]) == [f"train/{first.id}"]
    assert unpack(other, file) == [f"train/{first.id}"]
    with pytest.raises(InputError, match="has no version of rollouts"):
        pack(store, file, ["rollouts"])


def test_what_is_whole_stays_and_what_lacks_a_file_is_replaced(store, make, tmp_path):
    kept, broken = make("train", {"n": 1}, weights=b"1"), make("train", {"n": 2}, weights=b"2")
    file = tmp_path / "versions.tar.xz"
    pack(store, file)
    before = store.folder("train", kept.id).stat().st_ino
    (store.folder("train", broken.id) / "weights").unlink()
    assert unpack(store, file) == [f"train/{broken.id}"]
    assert store.folder("train", kept.id).stat().st_ino == before
    assert damaged_files(store.folder("train", broken.id)) == []


def test_damage_is_not_packed(store, make, tmp_path):
    recipe = make("train", {"n": 1}, weights=b"1")
    (store.folder("train", recipe.id) / "weights").write_bytes(b"2")
    with pytest.raises(InputError, match="weights is not what was written"):
        pack(store, tmp_path / "versions.tar.xz")
    assert not (tmp_path / "versions.tar.xz").exists()


def test_damage_is_not_unpacked(store, make, other, tmp_path):
    good, bad = make("train", {"n": 1}), make("train", {"n": 2}, weights=b"1")
    (store.folder("train", bad.id) / "weights").write_bytes(b"2")
    file = tmp_path / "versions.tar.xz"
    with tarfile.open(file, "w:xz") as archive:
        for recipe in (good, bad):
            archive.add(store.folder("train", recipe.id), arcname=f"train/{recipe.id}")
    with pytest.raises(InputError, match=f"train/{bad.id} in it is not what was packed"):
        unpack(other, file)
    assert not list(other.folders())


@pytest.mark.parametrize("kept", [0, 40, 0.7])
def test_a_file_that_is_no_archive_is_refused_in_one_line(store, make, other, tmp_path, kept):
    make("train", {"n": 1}, weights=bytes(range(256)) * 40)
    file = tmp_path / "versions.tar.xz"
    pack(store, file)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(kept * len(whole)) if kept < 1 else kept])
    with pytest.raises(InputError, match=r"archive of versions|not what was packed") as caught:
        unpack(other, file)
    assert "\n" not in str(caught.value)
    assert not list(other.folders())


@pytest.mark.parametrize(
    ("name", "link"), [("../../outside", ""), ("{outside}", ""), ("train/1/weights", "{outside}")]
)
def test_paths_that_lead_elsewhere_are_refused(other, tmp_path, name, link):
    file, outside = tmp_path / "versions.tar.xz", tmp_path / "outside"
    outside.write_text("kept")
    member = tarfile.TarInfo(name.format(outside=outside))
    member.type, member.linkname = (
        (tarfile.SYMTYPE if link else tarfile.REGTYPE),
        link.format(outside=outside),
    )
    with tarfile.open(file, "w:xz") as archive:
        archive.addfile(member)
    with pytest.raises(InputError, match="is no file of a version"):
        unpack(other, file)
    assert outside.read_text() == "kept"
    assert not list(other.folders())
