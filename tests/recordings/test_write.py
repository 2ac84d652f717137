import dataclasses
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from slapshot.errors import InputError
from slapshot.recordings import write
from slapshot.recordings.format import HITS_SCHEMA, TRACKS_SCHEMA, joint_schema
from slapshot.recordings.read import read_recording
from slapshot.recordings.write import write_recording

from .builder import assert_same, make_recording


def test_what_is_written_is_read(tmp_path: Path) -> None:
    recording = make_recording()
    write_recording(recording, tmp_path / "new" / "recording")
    assert_same(read_recording(tmp_path / "new" / "recording"), recording)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["recording"]


def test_content_repeats_byte_for_byte(tmp_path: Path) -> None:
    for name in "ab":
        write_recording(make_recording(), tmp_path / name)
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert len(files) == 5
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_files_say_units_and_are_zstd(folder: Path) -> None:
    for name, schema in (
        ("hits", HITS_SCHEMA),
        ("tracks", TRACKS_SCHEMA),
        ("commands", joint_schema(7)),
        ("joints", joint_schema(7)),
    ):
        file = pq.ParquetFile(folder / f"{name}.parquet")
        assert file.schema_arrow.names == schema.names
        for field in schema:
            stored = file.schema_arrow.field(field.name)
            assert stored.metadata[b"unit"] == field.metadata[b"unit"]
            assert stored.nullable == field.nullable
        assert file.metadata.row_group(0).column(0).compression == "ZSTD"
    units = {field.name: field.metadata[b"unit"] for field in TRACKS_SCHEMA}
    assert units == {"hit": b"", "t": b"s", "x": b"m", "y": b"m", "yaw": b"rad"}


def test_absent_optional_keys_are_not_written(tmp_path: Path) -> None:
    recording = make_recording()
    recording = dataclasses.replace(
        recording,
        hits=recording.hits.drop(columns="latent"),
        trajectory_model=None,
        sealed_truth_sha256=None,
    )
    write_recording(recording, tmp_path / "r")
    keys = set(json.loads((tmp_path / "r" / "recording.json").read_text()))
    assert "trajectory_model" not in keys
    assert "sealed_truth_sha256" not in keys
    assert read_recording(tmp_path / "r").trajectory_model is None


def test_existing_folder_is_refused_and_kept(folder: Path) -> None:
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match="exists already"):
        write_recording(make_recording(seed=1), folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_bad_recording_leaves_nothing(tmp_path: Path) -> None:
    recording = make_recording()
    tracks = recording.tracks.copy()
    tracks.loc[3, "x"] = np.inf
    with pytest.raises(InputError, match=r"tracks\.parquet: row 3 .* 'x' is infinite"):
        write_recording(dataclasses.replace(recording, tracks=tracks), tmp_path / "r")
    with pytest.raises(
        InputError, match=r"recording\.json: camera_rate_hz: 0\.0 is out of range; it must be > 0"
    ):
        write_recording(dataclasses.replace(recording, camera_rate_hz=0.0), tmp_path / "r")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("boom")])
def test_interrupted_write_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(write, "write_parquet", fail)
    with pytest.raises(type(error)):
        write_recording(make_recording(), tmp_path / "r")
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(write, "write_parquet", fail)
    with pytest.raises(InputError, match="No space left"):
        write_recording(make_recording(), tmp_path / "r")
    assert list(tmp_path.iterdir()) == []


def test_parent_that_is_a_file_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_recording(make_recording(), tmp_path / "file" / "r")


def test_mixed_types_in_a_frame_are_refused(tmp_path: Path) -> None:
    recording = make_recording()
    hits = recording.hits.astype({"order": object})
    hits.loc[2, "order"] = "third"
    with pytest.raises(InputError, match="'order' mixes types"):
        write_recording(dataclasses.replace(recording, hits=hits), tmp_path / "r")
