import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.recordings.__main__ import main
from slapshot.recordings.format import Recording
from slapshot.recordings.read import read_recording
from slapshot.recordings.summary import describe_hits, missing_frames, rest_point_scatter
from slapshot.recordings.write import write_recording

from .builder import assert_same, assert_same_tables, make_recording


def tracks_only(recording: Recording) -> Recording:
    return dataclasses.replace(
        recording,
        hits=recording.hits.assign(latent=None),
        commands=None,
        joints=None,
        trajectory_model=None,
    )


def rest_with_latents(recording: Recording) -> Recording:
    return dataclasses.replace(recording, tracks=None, commands=None, joints=None)


def rest_with_commands(recording: Recording) -> Recording:
    hits = recording.hits.assign(latent=None)
    return dataclasses.replace(recording, hits=hits, tracks=None, joints=None)


@pytest.mark.parametrize(
    ("reduce", "kind"),
    [
        (lambda recording: recording, "full"),
        (tracks_only, "tracks only"),
        (rest_with_latents, "rest points only"),
        (rest_with_commands, "rest points only"),
    ],
)
def test_kinds(tmp_path: Path, reduce, kind: str) -> None:
    recording = reduce(make_recording())
    write_recording(recording, tmp_path / "r")
    back = read_recording(tmp_path / "r")
    assert back.kind == kind
    assert_same(back, recording)
    assert f"kind           {kind}" in describe_hits(back)


@pytest.mark.parametrize("n_joints", [1, 6, 12])
def test_number_of_joints_is_free(tmp_path: Path, n_joints: int) -> None:
    write_recording(make_recording(n_joints=n_joints), tmp_path / "r")
    back = read_recording(tmp_path / "r")
    assert list(back.commands.columns) == ["hit", "t", *(f"q{j}" for j in range(n_joints))]


def test_column_order_does_not_matter(folder: Path) -> None:
    for name in ("hits", "tracks", "commands", "joints"):
        table = pq.read_table(folder / f"{name}.parquet")
        pq.write_table(table.select(table.column_names[::-1]), folder / f"{name}.parquet")
    assert_same(read_recording(folder), make_recording())


def test_plain_pandas_files_are_read(folder: Path) -> None:
    """What a user writes with pandas: integers as floats, categories, int32, float32."""
    recording = make_recording()
    hits = recording.hits.astype({"command_id": float, "object_id": "category", "hit": "int32"})
    hits["order"] = hits["order"].astype(float)
    hits.to_parquet(folder / "hits.parquet", index=False)
    tracks = recording.tracks.astype({"hit": float}).drop(columns="yaw")
    tracks.to_parquet(folder / "tracks.parquet", index=False)
    back = read_recording(folder)
    pd.testing.assert_frame_equal(back.hits, recording.hits)
    pd.testing.assert_frame_equal(back.tracks, recording.tracks.assign(yaw=np.nan))


def test_small_floats_and_whole_positions_are_read(folder: Path) -> None:
    tracks = make_recording().tracks.astype({"t": "float32", "yaw": "float32"})
    tracks["x"] = np.arange(len(tracks)) % 3
    tracks.to_parquet(folder / "tracks.parquet", index=False)
    back = read_recording(folder)
    assert (back.tracks.dtypes[["t", "x", "y", "yaw"]] == np.float64).all()


def test_nulls_of_any_type_are_nulls(folder: Path) -> None:
    hits = make_recording().hits.assign(recorded_at=np.nan, command_id=None)
    hits.to_parquet(folder / "hits.parquet", index=False)
    back = read_recording(folder).hits
    assert back["recorded_at"].isna().all()
    assert back["command_id"].isna().all()
    assert back["command_id"].dtype == pd.Int64Dtype()


def test_nan_in_a_nullable_column_is_null(folder: Path) -> None:
    """pyarrow, unlike pandas, writes NaN as NaN."""
    table = pq.read_table(folder / "hits.parquet")
    for name in ("rest_x", "rest_y"):
        values = pa.array(table[name].to_numpy(), from_pandas=False)
        assert values.null_count == 0
        table = table.set_column(table.schema.get_field_index(name), name, values)
    pq.write_table(table, folder / "hits.parquet")
    assert_same(read_recording(folder), make_recording())


def test_large_command_ids_are_exact(tmp_path: Path) -> None:
    recording = make_recording()
    hits = recording.hits.copy()
    hits.loc[1, "command_id"] = 2**62 + 1
    write_recording(dataclasses.replace(recording, hits=hits), tmp_path / "r")
    assert read_recording(tmp_path / "r").hits["command_id"].iloc[1] == 2**62 + 1


def test_times_of_another_zone_and_unit_are_read(folder: Path) -> None:
    recording = make_recording()
    hits = recording.hits.copy()
    hits["recorded_at"] = hits["recorded_at"].dt.tz_convert("Europe/Berlin").dt.as_unit("ns")
    hits.to_parquet(folder / "hits.parquet", index=False)
    assert_same_tables(read_recording(folder), recording)


def test_interleaved_hits_and_other_files_are_fine(folder: Path) -> None:
    tracks = make_recording().tracks.sort_values("t", kind="stable").reset_index(drop=True)
    tracks.to_parquet(folder / "tracks.parquet", index=False)
    (folder / "README.txt").write_text("a user's own notes")
    pd.testing.assert_frame_equal(read_recording(folder).tracks, tracks)


def test_hits_without_track_or_commands_are_fine(folder: Path) -> None:
    for name in ("tracks", "commands", "joints"):
        table = getattr(make_recording(), name)
        table[table["hit"] != 12].to_parquet(folder / f"{name}.parquet", index=False)
    assert 12 not in set(read_recording(folder).tracks["hit"])


def test_a_few_mistracks_are_no_wrong_unit(folder: Path) -> None:
    tracks = make_recording().tracks
    tracks.loc[[4, 20], "x"] = 5000.0
    tracks.to_parquet(folder / "tracks.parquet", index=False)
    assert read_recording(folder).tracks["x"].max() == 5000.0


def test_repeats_may_differ_by_rounding(folder: Path) -> None:
    commands = make_recording().commands
    commands["q0"] = commands["q0"].round(10)
    commands.loc[commands["hit"] == 11, "q0"] += 5e-10
    commands.to_parquet(folder / "commands.parquet", index=False)
    read_recording(folder)


def test_byte_order_mark_is_read(folder: Path) -> None:
    file = folder / "recording.json"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert_same(read_recording(folder), make_recording())


def test_scatter_of_repeats() -> None:
    """Two repeats at distance d scatter by d / sqrt(2); another object and lone hits count not."""
    hits = pd.DataFrame(
        {
            "command_id": pd.array([1, 1, 1, 2, None, None, 2], dtype="Int64"),
            "object_id": ["a", "a", "b", "a", "a", "a", "a"],
            "rest_x": [0.0, 0.3, 9.0, 5.0, 1.0, 2.0, np.nan],
            "rest_y": [0.0, 0.4, 9.0, 5.0, 1.0, 2.0, np.nan],
        }
    )
    assert rest_point_scatter(hits) == pytest.approx(0.5 / np.sqrt(2))
    assert np.isnan(rest_point_scatter(hits.iloc[2:]))


def test_scatter_estimates_the_standard_deviation() -> None:
    """Against a known answer: sigma a axis gives sqrt(2) sigma."""
    rng = np.random.default_rng(0)
    n_groups, n_repeats, sigma = 200, 5, 0.05
    rest = rng.normal(0, sigma, (n_groups, n_repeats, 2)) + rng.normal(0, 1, (n_groups, 1, 2))
    rest = rest.reshape(-1, 2)
    command = pd.array(np.repeat(np.arange(n_groups), n_repeats), dtype="Int64")
    hits = pd.DataFrame({"command_id": command, "object_id": "a", "rest_x": rest[:, 0], "rest_y": rest[:, 1]})
    freedom = 2 * n_groups * (n_repeats - 1)
    tolerance = 6 * np.sqrt(1 / (2 * freedom))  # relative standard error of a standard deviation
    assert rest_point_scatter(hits) == pytest.approx(np.sqrt(2) * sigma, rel=tolerance)


def test_missing_frames() -> None:
    tracks = pd.DataFrame({"hit": [1, 1, 1, 2, 2], "t": [0.0, 0.1, 0.4, 1.0, 1.1]})
    assert missing_frames(tracks, 10.0) == pytest.approx(2 / 7)
    assert missing_frames(tracks.iloc[:2], 10.0) == 0.0


def test_command_line_describes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(folder)]) == 0
    out = capsys.readouterr().out
    for words in (
        "test-rig: stand-in (simulated), not a real robot",
        "kind           full",
        "ice: cylinder, 0.16 +- 0.001 kg, 4 hits",
        "inline: cylinder, 0.08 +- 0.001 kg, 2 hits",
        "2 commands, 4 hits, rest points scatter",
        "50 Hz, 11.8% of frames missing",
        "6.0 s in 6 hits",
    ):
        assert words in out


def test_command_line_says_real_robot(tmp_path: Path) -> None:
    recording = dataclasses.replace(make_recording(), stand_in=False, sealed_truth_sha256=None)
    text = describe_hits(recording)
    assert "test-rig: real robot" in text
    assert "stand-in" not in text


def test_command_line_error_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "nowhere")]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
