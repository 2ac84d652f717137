"""Tracks from anybody's CSV files: what comes in, what is dropped, and what is refused in which words."""

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from slapshot.errors import InputError
from slapshot.recordings.cli import format_import_summary, run_import
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.format import Recording
from slapshot.recordings.importing.mapping import load_mapping
from slapshot.recordings.importing.track_importer import ImportSummary, import_tracks
from slapshot.recordings.motion_detection import find_motion_intervals, find_slide
from slapshot.recordings.read import read_recording

from .slide_tracks import RATE_HZ, slide, write_csv, write_mapping

ROOT = Path(__file__).parents[2]
LASA_MAPPING = ROOT / "config/recordings/lasa-hits.yaml"


def rows_of(t: np.ndarray, xy: np.ndarray) -> list[list[float]]:
    return np.column_stack([t, xy]).tolist()


def imported(folder: Path, source: Path | None = None, **changes: Any) -> tuple[Recording, ImportSummary]:
    """What the CSV files in folder/csv become."""
    mapping = write_mapping(folder / "mapping.yaml", **changes)
    summary = import_tracks(mapping, source or folder / "csv", folder / "out")
    return read_recording(folder / "out"), summary


def refused(folder: Path, *words: str, source: Path | None = None, **changes: Any) -> str:
    """The message, which holds the words, with nothing written."""
    with pytest.raises(InputError) as caught:
        imported(folder, source, **changes)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
    assert not (folder / "out").exists()
    return message


def message_of(call: Callable[[], Any]) -> str:
    """The one error that is allowed; empty without it."""
    try:
        call()
    except InputError as error:
        return str(error)
    return ""


def test_a_folder_of_csv_files_becomes_a_recording(tmp_path: Path) -> None:
    tracks = {f"hit{i}.csv": slide(1.0 + 0.1 * i, seed=i) for i in (10, 2, 1)}
    for name, track in tracks.items():
        write_csv(tmp_path / "csv" / name, rows_of(*track), ["t", "x", "y"])
    recording, summary = imported(tmp_path)
    assert summary.hits == 3
    assert not recording.stand_in
    assert recording.kind == "tracks only"
    assert recording.tracks is not None
    # Natural order: hit2 before hit10.
    for hit, name in enumerate(("hit1.csv", "hit2.csv", "hit10.csv")):
        t, xy = tracks[name]
        frames = recording.tracks[recording.tracks["hit"] == hit]
        np.testing.assert_allclose(frames["t"], t)
        np.testing.assert_allclose(frames[["x", "y"]], xy)
        row = recording.hits.loc[recording.hits["hit"] == hit].iloc[0]
        assert row["order"] == hit
        assert (row["start_x"], row["start_y"]) == pytest.approx(tuple(xy[0]), abs=0.001)
        assert (row["rest_x"], row["rest_y"]) == pytest.approx(tuple(xy[-1]), abs=0.001)
    sources = json.loads((tmp_path / "out/import.json").read_text())["hits"]
    assert [source["source"] for source in sources] == ["hit1.csv", "hit2.csv", "hit10.csv"]
    assert sources[0]["first_line"] == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["csv", "mapping.yaml", "out"]


def test_columns_by_number_units_and_counted_time(tmp_path: Path) -> None:
    t, xy = slide()
    # Memory that nobody wrote to stands in columns that nobody names.
    rows = [["6.95311e-310", 1000 * x, "1e+160", -1000 * y, "inf", ""] for x, y in xy]
    write_csv(tmp_path / "csv/a.csv", rows, delimiter=";")
    recording, summary = imported(
        tmp_path,
        csv={"header": False, "delimiter": ";"},
        columns={
            "x": {"column": 1, "factor": 0.001, "offset": 0.5},
            "y": {"column": 3, "factor": -0.001},
        },
    )
    assert recording.tracks is not None
    np.testing.assert_allclose(recording.tracks["x"], xy[:, 0] + 0.5)
    np.testing.assert_allclose(recording.tracks["y"], xy[:, 1])
    np.testing.assert_allclose(recording.tracks["t"], t)
    assert any("no clock" in line for line in summary.lines)
    assert "no clock" in recording.note


def test_a_clock_of_the_epoch_may_say_the_order(tmp_path: Path) -> None:
    """Against that of the names: the faster slide came first."""
    for name, begin, speed in (("a", 1.7e9 + 60, 1.0), ("b", 1.7e9, 1.6)):
        t, xy = slide(speed)
        write_csv(tmp_path / "csv" / f"{name}.csv", rows_of(begin + t, xy), ["stamp", "x", "y"])
    recording, _ = imported(tmp_path, columns={"t": "stamp", "x": "x", "y": "y", "order": "stamp"})
    assert recording.tracks is not None
    ways = recording.tracks.groupby("hit")[["x", "y"]].agg(np.ptp).max(axis=1)
    first, second = recording.hits.sort_values("order")["hit"]
    assert ways[first] > 2 * ways[second]


def test_one_long_table_with_a_hit_column_order_dates_and_fields(tmp_path: Path) -> None:
    rows = []
    for hit, place, object_id, day in (("b", 1, "big", 2), ("a", 2, "small", 1), ("c", 0, "big", 1)):
        t, xy = slide(seed=place)
        rows += [[hit, place, object_id, f"2026-03-0{day} 10:00", *row] for row in rows_of(100 + t, xy)]
    write_csv(tmp_path / "long.csv", rows, ["hit", "place", "object", "when", "t", "x", "y"])
    box = {"shape": "box", "size_m": [0.2, 0.2, 0.1], "mass_kg": 0.4, "mass_sd_kg": 0.01}
    recording, _ = imported(
        tmp_path,
        tmp_path / "long.csv",
        objects={"big": box, "small": box},
        object_id="{object}",
        command="{object}",
        columns={"t": "t", "x": "x", "y": "y", "hit": "hit", "order": "place"},
        fields={"object": "object", "when": "when"},
        recorded_at={"text": "{when}", "format": "%Y-%m-%d %H:%M", "utc_offset_h": 1},
    )
    assert recording.hits["object_id"].tolist() == ["big", "big", "small"]
    assert recording.hits["command_id"].tolist() == [0, 0, 1]
    assert recording.hits["recorded_at"].dt.hour.tolist() == [9, 9, 9]
    assert recording.hits["recorded_at"].dt.day.tolist() == [1, 2, 1]
    assert recording.tracks is not None
    assert (recording.tracks.groupby("hit")["t"].min() == 0).all()


def test_the_files_name_gives_fields(tmp_path: Path) -> None:
    for name in ("s1_red_3.csv", "s1_blue_4.csv"):
        write_csv(tmp_path / "csv/monday" / name, rows_of(*slide()), ["t", "x", "y"])
    box = {"shape": "box", "size_m": [0.2, 0.2, 0.1], "mass_kg": 0.4, "mass_sd_kg": 0.01}
    files = {"pattern": "**/*.csv", "name_pattern": r"^s\d_(?P<colour>[a-z]+)_"}
    recording, _ = imported(tmp_path, objects={"red": box, "blue": box}, object_id="{colour}", files=files)
    assert recording.hits["object_id"].tolist() == ["blue", "red"]
    fields = json.loads((tmp_path / "out/import.json").read_text())["hits"][0]["fields"]
    assert fields == {"file": "s1_blue_4", "folder": "monday", "colour": "blue"}


def test_a_changed_column_begins_a_new_hit(tmp_path: Path) -> None:
    first, second = slide(seed=1), slide(1.5, seed=2)
    rows = [[1, *xy] for xy in first[1]] + [[2, *xy] for xy in second[1]]
    write_csv(tmp_path / "csv/a.csv", rows)
    recording, summary = imported(tmp_path, csv={"header": False}, columns={"x": 1, "y": 2, "new_hit": 0})
    assert summary.hits == 2
    assert recording.tracks is not None
    assert recording.tracks["hit"].value_counts().tolist() == sorted([len(first[0]), len(second[0])])[::-1]


def test_a_hit_is_cropped_to_its_slide(tmp_path: Path) -> None:
    t, xy = slide(before_s=2.0, after_s=90.0)
    write_csv(tmp_path / "csv/a.csv", rows_of(t, xy), ["t", "x", "y"])
    recording, summary = imported(tmp_path, crop={"before_motion_s": 0.3, "after_rest_s": 0.5})
    assert recording.tracks is not None
    lasts = recording.tracks["t"].iloc[-1]
    assert lasts == pytest.approx(0.3 + 1.2 / (0.2 * 9.81) + 0.5, abs=0.1)
    assert recording.tracks["t"].iloc[0] == 0
    assert summary.lines[-1].startswith("a.csv: lasted 93 s and was cropped to 1.")


def test_hits_that_cannot_be_used_are_dropped_with_a_reason(tmp_path: Path) -> None:
    t, xy = slide()
    moving = slice(70, None)
    put_back = np.where(np.arange(len(t))[:, None] > 100, xy[0] + [0.0, 0.4], xy[0])
    cases = {
        "begins.csv": (t[moving], xy[moving]),
        "good.csv": (t, xy),
        "put_back.csv": (t, put_back),
        "runs_on.csv": slide(after_s=70.0),
        "short.csv": (t[:3], xy[:3]),
        "still.csv": (t, xy[:1] + 0.001 * np.sin(xy)),
    }
    for name, track in cases.items():
        write_csv(tmp_path / "csv" / name, rows_of(*track), ["t", "x", "y"])
    _, summary = imported(tmp_path)
    assert summary.hits == 1
    assert summary.dropped == tuple(sorted(set(cases) - {"good.csv"}))
    lines = {line.partition(":")[0]: line for line in summary.lines}
    assert "moves from its first frame" in lines["begins.csv"]
    assert "only jumps" in lines["put_back.csv"]
    assert "longer than longest_s" in lines["runs_on.csv"]
    assert "only 3 frames" in lines["short.csv"]
    assert "never moves" in lines["still.csv"]
    assert format_import_summary(summary).count("\n") == len(summary.lines)


def test_a_hit_still_moving_at_its_end_keeps_no_rest_point(tmp_path: Path) -> None:
    t, xy = slide()
    write_csv(tmp_path / "csv/a.csv", rows_of(t[:90], xy[:90]), ["t", "x", "y"])
    write_csv(tmp_path / "csv/b.csv", rows_of(t, xy), ["t", "x", "y"])
    recording, summary = imported(tmp_path)
    assert recording.hits["rest_x"].isna().tolist() == [True, False]
    assert any("still moves in its last frame" in line for line in summary.lines)


def test_a_hit_seen_from_its_launch_may_be_kept(tmp_path: Path) -> None:
    t, xy = slide(before_s=0.0)
    write_csv(tmp_path / "csv/a.csv", rows_of(t, xy), ["t", "x", "y"])
    recording, _ = imported(tmp_path, moving_at_start="keep")
    assert recording.hits["start_x"].iloc[0] == pytest.approx(xy[0, 0])


def test_a_nudge_before_and_a_hand_after_the_hit_are_no_part_of_it(tmp_path: Path) -> None:
    t, xy = slide(before_s=1.5, after_s=3.0)
    nudged, rest = xy.copy(), 1.5 + 1.2 / (0.2 * 9.81)
    nudged[t < 0.5] -= [0.03, 0.0]
    ramp = (t >= 0.5) & (t < 0.8)
    nudged[ramp] -= np.outer((0.8 - t[ramp]) / 0.3, [0.03, 0.0])
    hand = t > rest + 1.5
    nudged[hand] += np.outer(np.minimum(t[hand] - rest - 1.5, 0.5), [-0.5, 0.1])
    write_csv(tmp_path / "csv/a.csv", rows_of(t, nudged), ["t", "x", "y"])
    recording, summary = imported(tmp_path, crop={"before_motion_s": 1.0, "after_rest_s": 5.0})
    row = recording.hits.iloc[0]
    assert (row["start_x"], row["start_y"]) == pytest.approx((0.5, 0.1), abs=0.001)
    assert row["rest_x"] == pytest.approx(xy[-1, 0], abs=0.001)
    assert recording.tracks is not None
    assert recording.tracks["x"].iloc[-1] == pytest.approx(xy[-1, 0], abs=0.03)
    assert any("before the hit" in line and "after its rest" in line for line in summary.lines)


def test_frames_that_saw_nothing_become_gaps(tmp_path: Path) -> None:
    t, xy = slide()
    rows: list[list[Any]] = rows_of(t, xy)
    rows[20][1], rows[21][1:], rows[40][2] = "", ["NaN", "NaN"], "-999"
    rows.insert(31, rows[30])  # a row that was written twice
    write_csv(tmp_path / "csv/a.csv", rows, ["t", "x", "y"])
    recording, summary = imported(tmp_path, csv={"missing": ["-999"]})
    assert recording.tracks is not None
    assert len(recording.tracks) == len(t) - 3
    assert f"3 of {len(t) + 1} frames did not detect the object" in summary.lines[-1]
    assert "1 duplicate frames" in summary.lines[-1]


@pytest.mark.parametrize("style", ["tabs", "blanks", "commas"])
def test_delimiters_and_decimal_commas(tmp_path: Path, style: str) -> None:
    t, xy = slide()
    rows = [[f"{value:.6f}" for value in row] for row in rows_of(t, xy)]
    lines = {
        "tabs": "\n".join("\t".join(row) for row in [["t", "x", "y"], *rows]),
        "blanks": "\n".join("  ".join(row) for row in [["t", "x", "y"], *rows]),
        "commas": "\n".join(";".join(row) for row in [["t", "x", "y"], *rows]).replace(".", ","),
    }[style]
    (tmp_path / "csv").mkdir()
    (tmp_path / "csv/a.csv").write_text("\ufeff" + lines)
    dialect = {
        "tabs": {"delimiter": "tab"},
        "blanks": {"delimiter": "blanks"},
        "commas": {"delimiter": ";", "decimal": ","},
    }[style]
    recording, _ = imported(tmp_path, csv=dialect)
    assert recording.tracks is not None
    np.testing.assert_allclose(recording.tracks[["x", "y"]], xy, atol=1e-6)


def test_a_last_line_that_is_cut_short_is_left_out(tmp_path: Path) -> None:
    t, xy = slide()
    write_csv(tmp_path / "csv/a.csv", rows_of(t, xy), ["t", "x", "y"])
    file = tmp_path / "csv/a.csv"
    file.write_text(file.read_text().rstrip().rpartition(",")[0])
    recording, summary = imported(tmp_path)
    assert recording.tracks is not None
    assert len(recording.tracks) == len(t) - 1
    assert "cut short" in summary.lines[-1]


def test_a_glob_takes_only_what_it_names(tmp_path: Path) -> None:
    for name in ("a1", "a2", "b1", ".a3"):
        write_csv(tmp_path / f"csv/{name}.csv", rows_of(*slide()), ["t", "x", "y"])
    _, summary = imported(tmp_path, tmp_path / "csv/a*.csv")
    assert summary.hits == 2


@pytest.mark.parametrize(
    ("line", "cell", "text", "words"),
    [
        (20, 1, "6.95e-310", ["line 22", "'x'", "cannot be", "another column"]),
        (20, 2, "3.4e160", ["line 22", "'y'", "cannot be"]),
        (20, 2, "inf", ["line 22", "'y'", "cannot be"]),
        (20, 1, "lost", ["line 22", "'lost' is no number", "csv.missing"]),
        (20, 0, "0.1", ["line 22", "time goes backwards"]),
        (20, 0, "0.19", ["line 22", "the same time at two places"]),
    ],
)
def test_what_cannot_be_in_a_named_column_is_refused_with_its_line(
    tmp_path: Path, line: int, cell: int, text: str, words: list[str]
) -> None:
    rows: list[list[Any]] = rows_of(*slide())
    rows[line][cell] = text
    write_csv(tmp_path / "csv/a.csv", rows, ["t", "x", "y"])
    refused(tmp_path, "a.csv", *words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["is empty"]),
        (b"t,x,y\n", ["has no rows"]),
        (b"t,x,z\n0,0,0\n", ["column 'y'", "is missing", "columns: t, x, z"]),
        (b"t,x,y,x\n0,0,0,0\n", ["column 'x'", "is duplicated"]),
        (b"0,0,0\n1,1,1\n", ["holds numbers", "header: false"]),
        (b"t,x,y\n0,0,0\n1,1\n2,2,2\n", ["line 3 has 2 columns"]),
        (b"P\0A\0R\0", ["binary or UTF-16"]),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, content: bytes, words: list[str]) -> None:
    (tmp_path / "csv").mkdir()
    (tmp_path / "csv/a.csv").write_bytes(content)
    refused(tmp_path, "a.csv", *words)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rig": None}, ["key 'rig' is missing", "name of the set-up"]),
        ({"colums": {}}, ["unknown key 'colums'", "write 'columns'"]),
        ({"columns": {"x": "x"}}, ["columns: key 'y' is missing"]),
        ({"columns": {"x": -1, "y": 2}}, ["mapping.yaml:3: columns.x: -1 is out of range; it must be >= 0"]),
        ({"columns": {"x": {"column": "x", "factor": "1e-3"}, "y": "y"}}, ["columns.x.factor", "a number"]),
        ({"columns": {"x": {"column": "x", "factor": 0}, "y": "y"}}, ["columns.x.factor", "0 would"]),
        ({"columns": {"x": "x", "y": "y", "start_x": "x"}}, ["both start_x and start_y"]),
        ({"csv": {"header": False}}, ["columns.x: 'x' is a name", "csv.header is false"]),
        ({"csv": {"delimiter": "ab"}}, ["csv.delimiter", "'ab'"]),
        ({"csv": {"decimal": ","}}, ["csv.decimal"]),
        ({"csv": {"skip_rows": -1}}, ["csv.skip_rows: -1 is out of range; it must be >= 0"]),
        ({"files": {"name_pattern": "("}}, ["files.name_pattern", "no regular expression"]),
        ({"files": {"name_pattern": "(?P<n>b)"}}, ["a.csv", "does not match"]),
        ({"files": {"pattern": "*.txt"}}, ["no file matches *.txt"]),
        ({"files": {"pattern": "/*.txt"}}, ["files.pattern"]),
        ({"object_id": "{colour}"}, ["object_id", "no field 'colour'", "known: file, folder"]),
        ({"object_id": "ball"}, ["a.csv", "'ball' is not among", "'box'"]),
        ({"fields": {"file": "x"}}, ["field 'file' is given twice"]),
        ({"moving_at_end": "maybe"}, ["moving_at_end", "keep or drop"]),
        ({"crop": {"before_motion_s": 1}}, ["crop", "after_rest_s"]),
        ({"camera_rate_hz": float("inf")}, ["camera_rate_hz", "not a finite number"]),
        ({"recorded_at": {"text": "{file}", "format": "%Y"}}, ["a.csv", "'a' is no time", "'%Y'"]),
        ({"columns": {"x": "x", "y": "y", "t": {"column": "t", "factor": 1000}}}, ["camera_rate_hz"]),
    ],
)
def test_a_mapping_that_cannot_be_is_refused_with_its_key(
    tmp_path: Path, changes: dict[str, Any], words: list[str]
) -> None:
    write_csv(tmp_path / "csv/a.csv", rows_of(*slide()), ["t", "x", "y"])
    refused(tmp_path, *words, **changes)


def test_an_empty_order_and_a_source_that_is_not_there_are_refused(tmp_path: Path) -> None:
    refused(tmp_path, "nothing: no such file; give a CSV file, or the folder", source=tmp_path / "nothing")
    rows = [[*row, ""] for row in rows_of(*slide())]
    write_csv(tmp_path / "csv/a.csv", rows, ["t", "x", "y", "n"])
    refused(tmp_path, "order is empty", columns={"t": "t", "x": "x", "y": "y", "order": "n"})


def test_a_recording_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    write_csv(tmp_path / "csv/a.csv", rows_of(*slide()), ["t", "x", "y"])
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="exists already"):
        imported(tmp_path)


# What people's programs leave behind, and what only chance would write.
CELLS = st.sampled_from(["", "0", "1.5", "-2e3", "nan", "inf", "1e-310", "x", '"', "1,5", "\0", "\x85", "é"])


@settings(max_examples=80)
@given(
    table=st.one_of(
        st.lists(st.lists(CELLS, max_size=5).map(",".join), max_size=12).map("\n".join).map(str.encode),
        st.binary(max_size=200),
    ),
    header=st.booleans(),
    delimiter=st.sampled_from([",", "blanks", "tab"]),
)
def test_whatever_a_file_holds_there_is_a_recording_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, table: bytes, header: bool, delimiter: str
) -> None:
    folder = tmp_path_factory.mktemp("any")
    (folder / "csv").mkdir()
    (folder / "csv/a.csv").write_bytes(table)
    columns = {"x": 0, "y": 1, "t": 2, "hit": 3} if len(table) % 2 else {"x": 0, "y": 1}
    csv = {"header": header, "delimiter": delimiter}
    message = message_of(lambda: imported(folder, csv=csv, columns=columns))
    assert "\n" not in message
    assert (folder / "out").exists() == (message == "")


@settings(max_examples=40)
@given(
    changes=st.dictionaries(
        st.sampled_from(["rig", "objects", "columns", "csv", "files", "crop", "camera_rate_hz", "note", "z"]),
        st.recursive(
            st.none() | st.booleans() | st.integers(-5, 5) | st.floats() | st.sampled_from(["x", "", "{a}"]),
            lambda inner: (
                st.lists(inner, max_size=3)
                | st.dictionaries(
                    st.sampled_from(["x", "y", "column", "box", "header", "pattern", "1"]), inner
                )
            ),
            max_leaves=6,
        ),
        min_size=1,
    )
)
def test_whatever_a_mapping_says_it_is_taken_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, changes: dict[str, Any]
) -> None:
    file = write_mapping(tmp_path_factory.mktemp("any") / "mapping.yaml", **changes)
    message = message_of(lambda: load_mapping(file))
    assert "\n" not in message
    assert message == "" or message.startswith(str(file))


@settings(max_examples=40)
@given(
    speed=st.floats(0.5, 2.5),
    friction=st.floats(0.1, 0.5),
    noise_mm=st.floats(0.0, 3.0),
    seed=st.integers(0, 1000),
    wrong=st.lists(st.integers(0, 400), max_size=3),
)
def test_motion_is_found_under_noise_and_mistracks(
    speed: float, friction: float, noise_mm: float, seed: int, wrong: list[int]
) -> None:
    t, xy = slide(speed, friction=friction, noise_m=noise_mm / 1000, seed=seed)
    for frame in {10 * (place // 10) % len(t) for place in wrong}:
        xy[frame] += 0.2
    found = find_slide(find_motion_intervals(t, xy))
    assert found is not None
    assert t[found.begin] == pytest.approx(0.5, abs=0.08)
    # Creeping slower than 0.2 m/s may count as rest, and half a window as motion.
    last = t[min(found.end, len(t) - 1)] - 0.5 - speed / (friction * 9.81)
    assert -0.2 / (friction * 9.81) - 0.06 < last < 0.06


def test_the_mapping_of_the_real_box_names_columns_and_no_place_of_this_machine() -> None:
    mapping = load_mapping(LASA_MAPPING)
    assert mapping.numbers["x"].column == 8
    assert not any(str(value).startswith("/") for value in yaml.safe_load(LASA_MAPPING.read_text()).values())


def test_the_real_box_is_imported_and_its_oddities_are_seen(tmp_path: Path) -> None:
    folder = Path(os.environ.get("SLAPSHOT_LASA_HITS", ROOT / "../shared/data/lasa-hits"))
    if not (folder / "tracks").is_dir():
        pytest.skip(f"no {folder / 'tracks'}: SLAPSHOT_LASA_HITS may name the folder of the real recordings")
    summary = import_tracks(LASA_MAPPING, folder / "tracks", tmp_path / "out")
    recording = read_recording(tmp_path / "out")
    assert summary.hits == 50
    assert [name.partition(",")[0] for name in summary.dropped] == ["object_data_275_00.csv"]
    assert recording.hits["rest_x"].notna().all()
    assert recording.tracks is not None
    assert recording.tracks.groupby("hit")["t"].max().max() < 5
    texts = "\n".join(map(str, quality_warnings(recording)))
    for words in ("no clock", "long and short steps alternate", "rises again", "friction differs from hit"):
        assert words in texts


def test_the_command_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_csv(tmp_path / "csv/a.csv", rows_of(*slide()), ["t", "x", "y"])
    mapping = write_mapping(tmp_path / "mapping.yaml")
    args = argparse.Namespace(mapping=mapping, source=tmp_path / "csv", out=tmp_path / "out")
    assert run_import(args) == 0
    first, *others = capsys.readouterr().out.splitlines()
    assert first == f"{tmp_path / 'out'}: 1 hits, {len(slide()[0])} frames"
    assert any("no order" in line for line in others)
    assert pd.read_parquet(tmp_path / "out/tracks.parquet")["t"].diff().median() == pytest.approx(1 / RATE_HZ)
