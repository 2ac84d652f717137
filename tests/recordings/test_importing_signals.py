"""Signals from anybody's CSV files: what comes in, on which clocks, in which units, and what is refused."""

import argparse
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from slapshot.errors import InputError
from slapshot.recordings.cli import run_check, run_import
from slapshot.recordings.importing.signal_importer import SignalSummary, import_signals
from slapshot.recordings.importing.signal_mapping import is_signal_mapping, load_signal_mapping
from slapshot.recordings.signal_quality import signal_warnings
from slapshot.recordings.signal_statistics import all_channel_statistics
from slapshot.recordings.signals import SignalRecording, read_signals

from .signal_builder import write_signal_mapping
from .slide_tracks import write_csv, write_mapping

ROOT = Path(__file__).parents[2]
MAPPINGS = sorted((ROOT / "config/recordings").glob("pendulum-*.yaml"))
PENDULUMS = Path(os.environ.get("SLAPSHOT_PENDULUMS", ROOT.parent / "shared/data/pendulums"))

T = np.arange(50) / 100
Q, U = np.sin(7 * T), np.cos(5 * T)
HEADER = ["time", "pos", "tau"]
POS = {"column": "pos", "role": "observation", "quantity": "position", "joint": "hinge", "unit": "rad"}
TAU = {"column": "tau", "role": "control", "quantity": "torque", "actuator": "motor", "unit": "N m"}


def good_rows(t: np.ndarray = T) -> list[list[float]]:
    return np.stack([t, np.sin(7 * (t - t[0])), np.cos(5 * (t - t[0]))], axis=1).tolist()


def imported(folder: Path, **changes: Any) -> tuple[SignalRecording, SignalSummary]:
    """What the CSV files in folder/csv become."""
    mapping = write_signal_mapping(folder / "mapping.yaml", **changes)
    summary = import_signals(mapping, folder / "csv", folder / "out")
    return read_signals(folder / "out"), summary


def refused(folder: Path, *words: str, **changes: Any) -> None:
    """One line that holds the words, with nothing written."""
    with pytest.raises(InputError) as caught:
        imported(folder, **changes)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
    assert not (folder / "out").exists()


def one_clock(**keys: Any) -> dict[str, Any]:
    return {"main": {"time": {"column": "time"}, **keys}}


def test_a_file_an_episode_in_natural_order(tmp_path: Path) -> None:
    for i in (10, 2, 1):
        write_csv(tmp_path / f"csv/run{i}.csv", [[t, i, u] for t, _, u in good_rows()], HEADER)
    recording, summary = imported(tmp_path, note="hot day", stand_in=True)
    assert (summary.episodes, summary.samples, summary.lines) == (3, 150, ())
    assert (recording.rig, recording.note, recording.stand_in) == ("test-rig", "hot day", True)
    assert recording.signals["main"].groupby("episode")["q"].first().tolist() == [1, 2, 10]
    sources = json.loads((tmp_path / "out/import.json").read_text())["episodes"]
    assert [source["main"]["source"] for source in sources] == ["run1.csv", "run2.csv", "run10.csv"]
    assert sources[0]["main"]["first_line"] == 2
    assert sources[0]["main"]["last_line"] == 51


def test_units_scales_signs_and_blanks_in_the_header(tmp_path: Path) -> None:
    rows = [[1000 * t, np.rad2deg(q), 1000 * u, 60 * q, "x"] for t, q, u in good_rows()]
    write_csv(tmp_path / "csv/a.csv", rows, ["time", " pos", " tau ", " speed", " comment"])
    rate = {"column": "speed", "role": "observation", "quantity": "velocity", "joint": "hinge", "unit": "rpm"}
    recording, _ = imported(
        tmp_path,
        clocks=one_clock(time={"column": "time", "unit": "ms"}),
        channels={
            "q": {**POS, "unit": "deg", "sign": -1, "offset": 90, "noise": 0.5},
            "u": {**TAU, "unit": "mNm", "scale": 6.0, "hold": "linear"},
            "v": rate,
        },
    )
    table = recording.signals["main"]
    np.testing.assert_allclose(table["t"], T, atol=1e-12)
    np.testing.assert_allclose(table["q"], np.pi / 2 - Q, atol=1e-12)
    np.testing.assert_allclose(table["u"], 6 * U, atol=1e-12)
    np.testing.assert_allclose(table["v"], 2 * np.pi * Q, atol=1e-12)
    assert {name: channel.unit for name, channel in recording.channels.items()} == {
        "q": "rad",
        "u": "N m",
        "v": "rad/s",
    }
    assert recording.channels["q"].noise == pytest.approx(np.deg2rad(0.5))
    assert recording.channels["u"].hold == "linear"


@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_absolute_stamps_begin_at_0_in_each_episode(tmp_path: Path, unit: str, factor: float) -> None:
    """Seconds from 1970 have 0.24 microseconds between neighbouring floats."""
    for i, begin in enumerate((1.7e9, 1.7e9 + 1000)):
        rows = [
            [round(factor * (begin + t), 1 if factor == 1 else None), q, u] for t, q, u in good_rows(T * 40)
        ]
        write_csv(tmp_path / f"csv/{i}.csv", rows, HEADER)
    recording, _ = imported(tmp_path, clocks=one_clock(time={"column": "time", "unit": unit}))
    for _, rows in recording.signals["main"].groupby("episode"):
        np.testing.assert_allclose(rows["t"], T * 40, atol=1e-6)


def test_a_column_tells_episodes_apart(tmp_path: Path) -> None:
    rows = [[name, *row] for name in ("b", "a10", "a9") for row in good_rows()]
    write_csv(tmp_path / "csv/all.csv", rows, ["run", *HEADER])
    recording, summary = imported(tmp_path, clocks=one_clock(episode="run"))
    assert summary.episodes == 3
    firsts = [
        source["main"]["first_line"]
        for source in json.loads((tmp_path / "out/import.json").read_text())["episodes"]
    ]
    assert firsts == [102, 52, 2]  # a9, a10, b
    assert recording.signals["main"]["episode"].tolist() == np.repeat([0, 1, 2], 50).tolist()


def test_several_files_on_several_clocks(tmp_path: Path) -> None:
    """Encoders from 0.025 s, a camera from 0.002 s, controls from 0.05 s: all from the first control."""
    for i in (1, 2):
        begin = 1e5 * i
        rows = np.stack([begin + 0.025 + T, Q], axis=1)
        write_csv(tmp_path / f"csv/enc_{i}.csv", rows.tolist(), ["time", "pos"])
        write_csv(
            tmp_path / f"csv/cmd_{i}.csv",
            [[begin + 0.05 + t, u] for t, u in zip(T, U, strict=True)],
            ["time", "tau"],
        )
        write_csv(
            tmp_path / f"csv/cam_{i}.csv",
            [[1000 * (begin + 0.002 + t), q] for t, q in zip(T, Q, strict=True)],
            ["ms", "z"],
        )
    named = {"name_pattern": r"_(?P<episode>\d+)$"}
    recording, summary = imported(
        tmp_path,
        clocks={
            "enc": {"files": {"pattern": "enc_*.csv", **named}, "time": {"column": "time"}},
            "cmd": {"files": {"pattern": "cmd_*.csv", **named}, "time": {"column": "time"}},
            "cam": {"files": {"pattern": "cam_*.csv", **named}, "time": {"column": "ms", "unit": "ms"}},
        },
        channels={
            "q": {**POS, "clock": "enc"},
            "u": {**TAU, "clock": "cmd"},
            "z": {
                "column": "z",
                "clock": "cam",
                "role": "observation",
                "quantity": "position",
                "site": "tip",
                "component": "z",
                "unit": "m",
            },
        },
    )
    assert summary.episodes == 2
    np.testing.assert_allclose(recording.signals["cmd"].query("episode == 1")["t"], T, atol=1e-9)
    np.testing.assert_allclose(recording.signals["enc"].query("episode == 1")["t"], T[3:] - 0.025, atol=1e-9)
    np.testing.assert_allclose(recording.signals["cam"].query("episode == 0")["t"], T[5:] - 0.048, atol=1e-9)
    assert summary.lines == (
        "episode 0, cam_1.csv: 5 rows stand before all controls were given and were left out",
        "episode 0, enc_1.csv: 3 rows stand before all controls were given and were left out",
        "episode 1, cam_2.csv: 5 rows stand before all controls were given and were left out",
        "episode 1, enc_2.csv: 3 rows stand before all controls were given and were left out",
    )


def test_controls_long_before_are_left_out_but_the_one_that_holds(tmp_path: Path) -> None:
    write_csv(
        tmp_path / "csv/enc.csv", [[200.055 + t, q] for t, q in zip(T, Q, strict=True)], ["time", "pos"]
    )
    write_csv(tmp_path / "csv/set.csv", [[t, t] for t in (0.0, 100.0, 200.0, 200.3)], ["time", "tau"])
    recording, summary = imported(
        tmp_path,
        clocks={
            "enc": {"files": {"pattern": "enc.csv"}, "time": {"column": "time"}},
            "set": {"files": {"pattern": "set.csv"}, "time": {"column": "time"}},
        },
        channels={"q": {**POS, "clock": "enc"}, "u": {**TAU, "clock": "set"}},
    )
    np.testing.assert_allclose(recording.signals["set"][["t", "u"]], [[0, 200], [0.3, 200.3]], atol=1e-9)
    np.testing.assert_allclose(recording.signals["enc"]["t"], 0.055 + T, atol=1e-9)
    assert summary.lines == ("episode 0, set.csv: 2 controls before the first observation were left out",)


def test_clocks_of_different_rates_may_share_a_file(tmp_path: Path) -> None:
    """A cell is empty where its clock was not read."""
    rows = [[t, q, u if i % 10 == 0 else ""] for i, (t, q, u) in enumerate(good_rows())]
    write_csv(tmp_path / "csv/a.csv", rows, HEADER)
    recording, _ = imported(
        tmp_path,
        clocks={"fast": {"time": {"column": "time"}}, "slow": {"time": {"column": "time"}}},
        channels={"q": {**POS, "clock": "fast"}, "u": {**TAU, "clock": "slow"}},
    )
    assert len(recording.signals["fast"]) == 50
    np.testing.assert_allclose(recording.signals["slow"]["t"], T[::10])
    refused_one = tmp_path / "one"
    write_csv(refused_one / "csv/a.csv", rows, HEADER)
    refused(refused_one, "a.csv: line 3: control 'u' is empty", "put it on a clock of its own")


def test_rows_before_a_controller_starts_are_left_out(tmp_path: Path) -> None:
    rows = [[t, q, u if i >= 7 else ""] for i, (t, q, u) in enumerate(good_rows())]
    write_csv(tmp_path / "csv/a.csv", rows, HEADER)
    recording, summary = imported(tmp_path)
    np.testing.assert_allclose(recording.signals["main"]["t"], T[7:] - T[7])
    assert summary.lines == (
        "episode 0, a.csv: 7 rows stand before all controls were given and were left out",
    )


def test_a_row_of_blank_cells_takes_its_time_where_rows_are_counted(tmp_path: Path) -> None:
    """Motion capture without a column of times, that lost an object from its tenth frame to its twentieth."""
    x = [["" if 10 <= i < 20 else f"{2 * t:.6g}"] * (2 if i != 14 else 3) for i, t in enumerate(T)]
    write_csv(tmp_path / "csv/a.csv", x, ["x", "y"])
    channels = {
        name: {"column": name, "role": "observation", "quantity": "position", "body": "ball",
               "component": name, "unit": "m"}
        for name in "xy"
    }  # fmt: skip
    rate = round(1 / (T[1] - T[0]))
    recording, summary = imported(tmp_path, clocks=one_clock(time={"rate_hz": rate}), channels=channels)
    kept = np.r_[0:10, 20 : len(T)]
    np.testing.assert_allclose(recording.signals["main"]["t"], T[kept], atol=1e-9)
    np.testing.assert_allclose(recording.signals["main"]["x"], 2 * T[kept], atol=1e-5)
    assert summary.lines == (f"episode 0, a.csv: 10 of {len(T)} rows have no time or no value",)


def test_an_angle_that_wraps_goes_on(tmp_path: Path) -> None:
    """In degrees, behind a gear of 5, an encoder that turns backwards and starts again at 0."""
    turned = 30 * T * 20 - 7  # deg of the joint
    rows = [[t, (-5 * angle) % 360] for t, angle in zip(T, turned, strict=True)]
    rows[11][1] = ""
    write_csv(tmp_path / "csv/a.csv", rows, ["time", "pos"])
    column = {"unit": "deg", "scale": 0.2, "sign": -1, "period": 360}
    recording, _ = imported(tmp_path, channels={"q": {**POS, **column}})
    found = np.rad2deg(recording.signals["main"]["q"])
    expected = np.delete(turned, 11)
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-9)
    assert turned.max() - turned.min() > 72  # of which each 72 degrees are a turn of the encoder


def test_counts_of_twenty_bits_wrap(tmp_path: Path) -> None:
    turned = 9 * T
    rows = [[t, round(angle / (2 * np.pi) * 2**20) % 2**20] for t, angle in zip(T, turned, strict=True)]
    write_csv(tmp_path / "csv/a.csv", rows, ["time", "pos"])
    column = {"unit": "rev", "scale": 2.0**-20, "period": 2**20}
    recording, _ = imported(tmp_path, channels={"q": {**POS, **column}})
    np.testing.assert_allclose(recording.signals["main"]["q"], turned, atol=1e-5)


def test_a_period_is_of_positions(tmp_path: Path) -> None:
    write_csv(tmp_path / "csv/a.csv", good_rows(), HEADER)
    refused(
        tmp_path, "channels.u.period", "is of observed positions",
        channels={"q": POS, "u": {**TAU, "period": 360}},
    )  # fmt: skip


@pytest.mark.parametrize("stamp", [1.7e12, 1.7e15, 1.7e18])
def test_stamps_of_another_unit_than_was_said(tmp_path: Path, stamp: float) -> None:
    write_csv(tmp_path / "csv/a.csv", [[stamp + 1e3 * t, q, u] for t, q, u in good_rows()], HEADER)
    refused(tmp_path, "line 2", "too large for a time in s", "ms, us or ns")


def test_a_free_body_without_controls(tmp_path: Path) -> None:
    x = np.stack([T, 2 * T, 0 * T, 1 + 3 * T - 4.905 * T**2], axis=1)
    write_csv(tmp_path / "csv/throw.csv", [*x.tolist()[:-1], ["0.49", "", "", ""]], ["t", "x", "y", "z"])
    body = {"role": "observation", "quantity": "position", "body": "ball", "unit": "m"}
    recording, summary = imported(
        tmp_path,
        clocks={"main": {"time": {"column": "t"}}},
        channels={axis: {"column": axis, "component": axis, **body} for axis in "xyz"},
    )
    np.testing.assert_allclose(recording.signals["main"][["t", "x", "y", "z"]], x[:-1])
    assert summary.lines == ("episode 0, throw.csv: 1 of 50 rows have no time or no value",)


def test_counted_rows_columns_by_number_and_other_styles(tmp_path: Path) -> None:
    rows = [[f"{q:.6f}".replace(".", ","), f"{u:.6f}".replace(".", ",")] for _, q, u in good_rows()]
    write_csv(tmp_path / "csv/a.txt", rows, delimiter=";")
    recording, _ = imported(
        tmp_path,
        clocks={
            "main": {
                "files": {"pattern": "*.txt"},
                "csv": {"header": False, "delimiter": ";", "decimal": ","},
                "time": {"rate_hz": 100},
            }
        },
        channels={"q": {**POS, "column": 0}, "u": {**TAU, "column": 1}},
    )
    np.testing.assert_allclose(recording.signals["main"], np.stack([0 * T, T, Q, U], axis=1), atol=1e-6)


@pytest.mark.parametrize(("keep", "value"), [("keep_first", 5.0), ("keep_last", 7.0)])
def test_rows_of_one_time(tmp_path: Path, keep: str, value: float) -> None:
    rows = good_rows()
    rows.insert(10, [rows[10][0], 5.0, 0.0])
    rows[11][1] = 7.0
    write_csv(tmp_path / "csv/a.csv", rows, HEADER)
    refused(tmp_path, "line 13: the same time twice (0.1 s in line 12", "say repeats: keep_last under time")
    recording, summary = imported(tmp_path, clocks=one_clock(time={"column": "time", "repeats": keep}))
    assert recording.signals["main"]["q"].iloc[10] == value
    assert summary.lines == ("episode 0, a.csv: 1 rows repeat the time of another and were left out",)


def test_computed_controls_may_be_tiny(tmp_path: Path) -> None:
    """As the tail of a Gaussian pulse; in tracks such numbers are memory that nobody wrote to."""
    write_csv(tmp_path / "csv/a.csv", [[t, q, 1e-75] for t, q, _ in good_rows()], HEADER)
    assert imported(tmp_path)[0].signals["main"]["u"].eq(1e-75).all()


REFUSALS: dict[str, tuple[dict[str, Any], list[str]]] = {
    "key unknown": ({"rate_hz": 3}, ["mapping.yaml:", "unknown key 'rate_hz'"]),
    "key of a channel unknown": (
        {"channels": {"q": {**POS, "factor": 2}, "u": TAU}},
        ["channels.q.factor: unknown key 'factor'", "scale"],
    ),
    "no channels": ({"channels": None}, ["key 'channels' is missing"]),
    "no clocks": ({"clocks": None}, ["key 'clocks' is missing"]),
    "no time": ({"clocks": {"main": {}}}, ["clocks.main: key 'time' is missing"]),
    "time twice told": (
        {"clocks": one_clock(time={"column": "time", "rate_hz": 3})},
        ["clocks.main.time: give either the column of times, or rate_hz"],
    ),
    "unit of time": (
        {"clocks": one_clock(time={"column": "time", "unit": "m"})},
        ["clocks.main.time.unit: 'm' is no unit of time; write s, ms, us or ns"],
    ),
    "unit unknown": (
        {"channels": {"q": {**POS, "unit": "furlong"}, "u": TAU}},
        ["channels.q.unit: 'furlong' is no unit that is known; write one of: rad"],
    ),
    "unit of another quantity": (
        {"channels": {"q": {**POS, "unit": "rpm"}, "u": TAU}},
        ["channels.q.unit: 'rad/s' is no unit of a position; write 'rad' or 'm'"],
    ),
    "clock unknown": (
        {"channels": {"q": POS, "u": {**TAU, "clock": "slow"}}},
        ["channels.u: is on clock 'slow', which is not among clocks (main)"],
    ),
    "clock without a channel": (
        {"clocks": {**one_clock(), "slow": {"time": {"column": "time"}}}},
        ["clocks.slow: has no channel; name it in one, or remove it"],
    ),
    "no observation": ({"channels": {"u": TAU}}, ["channels: has no observation"]),
    "sign": (
        {"channels": {"q": {**POS, "sign": 2}, "u": TAU}},
        ["channels.q.sign: 2 is not allowed; use one of: 1, -1"],
    ),
    "scale": (
        {"channels": {"q": {**POS, "scale": -2}, "u": TAU}},
        ["channels.q.scale: -2 is out of range; it must be > 0"],
    ),
    "column missing": (
        {"channels": {"q": {**POS, "column": "angle"}, "u": TAU}},
        ["a.csv: column 'angle' (q) is missing", "columns: time, pos, tau"],
    ),
    "column twice": (
        {"channels": {"q": {**POS, "column": "tau"}, "u": TAU}},
        ["channels.u.column: takes the column of q, 'tau'"],
    ),
    "time for a channel": (
        {"channels": {"q": {**POS, "column": "time"}, "u": TAU}},
        ["channels.q.column: takes the column of t, 'time'"],
    ),
    "names without a header": (
        {"clocks": one_clock(csv={"header": False})},
        ["clocks.main.time.column: 'time' is a name, but csv.header is false"],
    ),
    "delimiter": (
        {"clocks": one_clock(csv={"decimal": ","})},
        ["clocks.main.csv.decimal: is the delimiter ',', too"],
    ),
    "pattern": (
        {"clocks": one_clock(files={"name_pattern": "("})},
        ["clocks.main.files.name_pattern: no regular expression"],
    ),
    "no file": ({"clocks": one_clock(files={"pattern": "*.txt"})}, ["no file matches *.txt"]),
}


@pytest.mark.parametrize(("changes", "words"), REFUSALS.values(), ids=REFUSALS)
def test_mappings_that_cannot_be(tmp_path: Path, changes: dict[str, Any], words: list[str]) -> None:
    write_csv(tmp_path / "csv/a.csv", good_rows(), HEADER)
    refused(tmp_path, *words, **changes)


def test_files_that_cannot_be(tmp_path: Path) -> None:
    rows = good_rows()
    write_csv(tmp_path / "csv/a.csv", [*rows[20:], *rows[:20]], HEADER)
    refused(
        tmp_path, "a.csv: line 32: time goes backwards (0.49 s in line 31, then 0 s)", "identifies episodes"
    )
    write_csv(tmp_path / "csv/a.csv", [*rows[:5], [0.05, "up", 1], *rows[6:]], HEADER)
    refused(tmp_path, "a.csv: line 7, column 'pos' (q): 'up' is no number")
    write_csv(tmp_path / "csv/a.csv", [["", 1, 2]] * 3, HEADER)
    refused(tmp_path, "a.csv: has no row with a time and a value; correct the columns in")
    write_csv(tmp_path / "csv/a.csv", rows, HEADER)
    refused(
        tmp_path,
        "column 't': samples are 36 apart (median), too rare for seconds",
        clocks=one_clock(time={"column": "time", "unit": "h"}),
    )


def test_episodes_that_a_clock_lacks_are_named(tmp_path: Path) -> None:
    for name in ("enc_1", "enc_2", "cmd_1"):
        write_csv(tmp_path / f"csv/{name}.csv", good_rows(), HEADER)
    named = {"name_pattern": r"_(?P<episode>\d+)$"}
    clocks = {
        "enc": {"files": {"pattern": "enc_*.csv", **named}, "time": {"column": "time"}},
        "cmd": {"files": {"pattern": "cmd_*.csv", **named}, "time": {"column": "time"}},
    }
    channels = {"q": {**POS, "clock": "enc"}, "u": {**TAU, "clock": "cmd"}}
    refused(
        tmp_path,
        "clocks.cmd: has no episode '2', which clock 'enc' has in enc_2.csv; add its file",
        clocks=clocks,
        channels=channels,
    )
    write_csv(tmp_path / "csv/more_enc_1.csv", good_rows(), HEADER)
    clocks["enc"]["files"] = {"pattern": "*enc_*.csv", **named}
    refused(
        tmp_path, "more_enc_1.csv: episode '1' stands in enc_1.csv, too", clocks=clocks, channels=channels
    )


def test_clocks_that_share_no_time_are_refused(tmp_path: Path) -> None:
    write_csv(tmp_path / "csv/enc.csv", good_rows(), HEADER)
    write_csv(tmp_path / "csv/cmd.csv", good_rows(1e5 + T), HEADER)
    clocks = {
        name: {"files": {"pattern": f"{name}.csv"}, "time": {"column": "time"}} for name in ("enc", "cmd")
    }
    refused(
        tmp_path,
        "enc.csv: ends at 0.49 s, before controls begin at 100000 s; give all clocks the same zero",
        clocks=clocks,
        channels={"q": {**POS, "clock": "enc"}, "u": {**TAU, "clock": "cmd"}},
    )


def test_commands_take_either_mapping(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not is_signal_mapping(write_mapping(tmp_path / "tracks.yaml"))
    assert is_signal_mapping(write_signal_mapping(tmp_path / "old.yaml", format_version=None))
    write_csv(tmp_path / "csv/a.csv", good_rows(), HEADER)
    mapping, out = write_signal_mapping(tmp_path / "mapping.yaml"), tmp_path / "out"
    assert run_import(argparse.Namespace(mapping=mapping, source=tmp_path / "csv", out=out)) == 0
    assert capsys.readouterr().out == f"{out}: 1 episode, 50 samples\n"
    assert run_check(argparse.Namespace(recording=out)) == 0
    said = capsys.readouterr().out
    assert "kind           signals: 1 observed, 1 controlled" in said
    assert said.splitlines()[-1] == "warnings       none"


@pytest.mark.parametrize("mapping", MAPPINGS, ids=lambda file: file.stem)
def test_mappings_that_ship_are_valid(mapping: Path) -> None:
    rules = load_signal_mapping(mapping)
    joints = {channel.joint for channel in rules.channels.values()} - {None}
    assert joints == ({"hinge"} if "single" in mapping.name else {"Joint1", "Joint2"})
    assert not {"tau_meas1", "tau_pert1"} & {channel.column for channel in rules.channels.values()}


SHIPPED = [
    ("pendulum-single", "single/energy_shaping.csv", 1, 4000, set()),
    ("pendulum-double-sysid", "double", 4, 19_939, {"no_own_velocity", "outliers"}),
    ("pendulum-double-design-a", "double", 1, 4995, set()),
    ("pendulum-double-design-a-compensated", "double", 1, 2495, set()),
    ("pendulum-double-acrobot", "double/perturbed_acrobot_*.csv", 3, 11_579, {"no_own_velocity"}),
]


@pytest.mark.parametrize(
    ("name", "source", "episodes", "samples", "odd"), SHIPPED, ids=[case[0] for case in SHIPPED]
)
def test_real_pendulums(
    tmp_path: Path, name: str, source: str, episodes: int, samples: int, odd: set[str]
) -> None:
    """With the velocities of design A from the motors, and those of design C from the logging program."""
    if not PENDULUMS.is_dir():
        pytest.skip(f"no {PENDULUMS}: SLAPSHOT_PENDULUMS may name the folder of the real recordings")
    summary = import_signals(ROOT / f"config/recordings/{name}.yaml", PENDULUMS / source, tmp_path / "out")
    assert (summary.episodes, summary.samples) == (episodes, samples)
    recording = read_signals(tmp_path / "out")
    kinds = {finding.kind for finding in signal_warnings(recording, all_channel_statistics(recording))}
    assert odd <= kinds
    assert ("no_own_velocity" in kinds) == ("no_own_velocity" in odd)


def test_the_only_clock_need_not_be_named(tmp_path):
    write_csv(tmp_path / "csv" / "one.csv", good_rows(), HEADER)
    recording, _ = imported(tmp_path, clocks={"mocap": {"time": {"column": "time"}}})
    assert {channel.clock for channel in recording.channels.values()} == {"mocap"}


def test_flights_of_a_ball_are_imported_in_si(tmp_path):
    """A parabola in ms and mm, with a gap: places in m at times from 0."""
    t = 0.005 * np.arange(100)
    height = 1.2 + 3 * t - 9.81 / 2 * t**2
    rows = [[1e6 + 1e3 * a, 1e3 * 4 * a, 0.0, 1e3 * h] for a, h in zip(t, height, strict=True)]
    rows = [row if k not in (40, 41) else [row[0], "", "", ""] for k, row in enumerate(rows)]
    write_csv(tmp_path / "csv" / "throw.csv", rows, ["time_ms", "x_mm", "y_mm", "z_mm"])
    import_signals(ROOT / "config/recordings/ball.yaml", tmp_path / "csv", tmp_path / "out")
    table = read_signals(tmp_path / "out").signals["mocap"]
    kept = np.delete(np.arange(100), (40, 41))
    np.testing.assert_allclose(table["t"] - table["t"].iloc[0], t[kept], atol=1e-9)
    np.testing.assert_allclose(table["z"], height[kept], atol=1e-12)
