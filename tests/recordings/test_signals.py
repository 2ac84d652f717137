"""Recordings of signals are read as they were written, by whatever tool, and made of arrays."""

import dataclasses
import json
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slapshot.errors import InputError
from slapshot.recordings import write
from slapshot.recordings.__main__ import main
from slapshot.recordings.read import format_version, read_recording
from slapshot.recordings.signals import Channel, SignalRecording, read_signals, write_signals
from slapshot.recordings.write import write_recording

from .builder import make_recording
from .signal_builder import CHANNELS, assert_same_signals, changed, make_signals

FILES = ("episodes.parquet", "recording.json", "signals-camera.parquet", "signals-main.parquet")


@pytest.fixture
def signals_folder(tmp_path: Path) -> Path:
    write_signals(make_signals(seconds=0.4), tmp_path / "recording")
    return tmp_path / "recording"


def test_what_is_written_is_read(tmp_path: Path) -> None:
    recording = make_signals()
    write_signals(recording, tmp_path / "new" / "recording")
    assert_same_signals(read_signals(tmp_path / "new" / "recording"), recording)
    assert sorted(path.name for path in (tmp_path / "new/recording").iterdir()) == sorted(FILES)
    assert format_version(tmp_path / "new" / "recording") == 2


def test_content_repeats_byte_for_byte(tmp_path: Path) -> None:
    for name in "ab":
        write_signals(make_signals(seconds=0.2), tmp_path / name)
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_files_say_units_and_meanings(signals_folder: Path) -> None:
    schema = pq.ParquetFile(signals_folder / "signals-main.parquet").schema_arrow
    assert schema.names == ["episode", "t", "q", "v", "u"]
    assert [schema.field(name).metadata[b"unit"] for name in schema.names] == [
        b"",
        b"s",
        b"rad",
        b"rad/s",
        b"N m",
    ]
    assert schema.field("q").metadata[b"description"] == b"position of joint hinge"


def test_the_header_says_no_more_than_is_known(signals_folder: Path) -> None:
    values = json.loads((signals_folder / "recording.json").read_text())
    assert next(iter(values)) == "format_version"
    assert values["channels"]["q"] == {
        "clock": "main",
        "role": "observation",
        "quantity": "position",
        "joint": "hinge",
        "unit": "rad",
    }
    assert values["channels"]["u"]["hold"] == "linear"
    assert values["channels"]["free"]["noise"] == 0.1


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), sizes=st.lists(st.integers(2, 12), min_size=1, max_size=3))
def test_any_values_come_back_to_the_last_bit(seed: int, sizes: list[int]) -> None:
    """Observations of any size with holes, controls without, any times that increase."""
    rng = np.random.default_rng(seed)
    times = [np.cumsum(rng.uniform(1e-6, 0.5, size)) for size in sizes]
    seen = [rng.normal(size=size) * 10.0 ** rng.uniform(-300, 8, size) for size in sizes]
    for values in seen:
        values[1:][rng.random(len(values) - 1) < 0.3] = np.nan  # an episode without any would be refused
    told = [rng.normal(size=size) * 10.0 ** rng.uniform(-300, 8, size) for size in sizes]
    channels = {"q": (CHANNELS["q"], seen), "u": (CHANNELS["u"], told)}
    recording = SignalRecording.from_arrays(times, channels, "rig", stand_in=True, note="n")
    with tempfile.TemporaryDirectory() as parent:
        write_signals(recording, Path(parent) / "r")
        back = read_signals(Path(parent) / "r")
    assert_same_signals(back, recording)
    table = back.signals["main"]
    for episode, arrays in enumerate(zip(times, seen, told, strict=True)):
        rows = table.loc[table["episode"] == episode, ["t", "q", "u"]]
        np.testing.assert_array_equal(rows.to_numpy(), np.stack(arrays, axis=1))


def test_arrays_of_one_episode_need_no_list() -> None:
    t = np.arange(5) / 10
    recording = SignalRecording.from_arrays(t, {"q": (CHANNELS["q"], t**2)}, rig="one")
    assert recording.episodes["episode"].tolist() == [0]
    assert not recording.stand_in
    assert recording.signals["main"]["q"].tolist() == (t**2).tolist()
    of_lists = SignalRecording.from_arrays(t.tolist(), {"q": (CHANNELS["q"], (t**2).tolist())}, rig="one")
    assert_same_signals(recording, of_lists)


@pytest.mark.parametrize(
    ("t", "channels", "words"),
    [
        (np.arange(3.0) / 9, {"q": (CHANNELS["q"], np.zeros(2))}, "q: has lengths [2], but t [3]"),
        (np.arange(3.0) / 9, {"q": (CHANNELS["q"], [np.zeros(3)] * 2)}, "q: has lengths [3, 3], but t [3]"),
        (np.zeros((3, 2)), {"q": (CHANNELS["q"], np.zeros(3))}, "t: is no array of shape (n,)"),
        (np.arange(3.0) / 9, {"q": (CHANNELS["q"], ["a", "b", "c"])}, "q: holds what is no number"),
        (np.zeros(3), {"q": (CHANNELS["q"], np.zeros(3))}, "signals-main.parquet: row 1"),
        (np.arange(3.0) / 9, {}, "channels: is empty"),
        (
            np.arange(3.0) / 9,
            {"q": (CHANNELS["q"], np.zeros(3)), "s": (CHANNELS["seen"], np.zeros(3))},
            "several clocks (camera, main)",
        ),
        (
            np.arange(3.0) / 9,
            {"q": (CHANNELS["q"], np.zeros(3)), "u": (CHANNELS["u"], np.array([1, np.nan, 1]))},
            "control 'u' is empty",
        ),
    ],
)
def test_arrays_are_checked_as_files_are(t: np.ndarray, channels: dict, words: str) -> None:
    with pytest.raises(InputError) as caught:
        SignalRecording.from_arrays(t, channels, rig="r")
    assert words in str(caught.value)


def test_what_other_tools_write_is_read(signals_folder: Path) -> None:
    """Columns in another order, interleaved episodes, float32, whole numbers, no optional columns."""
    recording = make_signals(seconds=0.4)
    main = recording.signals["main"].assign(u=1)
    main = main.sample(frac=1, random_state=0).sort_values("t", kind="stable")[
        ["u", "v", "q", "t", "episode"]
    ]
    main.astype({"episode": float, "v": "float32"}).to_parquet(
        signals_folder / "signals-main.parquet", index=False
    )
    recording.episodes[["order", "episode"]].to_parquet(signals_folder / "episodes.parquet", index=False)
    back = read_signals(signals_folder)
    wanted = recording.signals["main"].assign(u=1.0).astype({"v": "float32"}).astype({"v": float})
    pd.testing.assert_frame_equal(back.signals["main"], wanted)
    assert back.episodes["repeat_of"].isna().all()
    assert back.episodes["recorded_at"].isna().all()


def test_no_controls_and_other_files_are_fine(tmp_path: Path) -> None:
    t = np.arange(50) / 100
    channels = {
        axis: (
            Channel(
                clock="camera", role="observation", quantity="position", body="ball", component=axis, unit="m"
            ),
            0.1 * t,
        )
        for axis in ("x", "y", "z")
    }
    write_signals(SignalRecording.from_arrays(t, channels, rig="thrown ball"), tmp_path / "r")
    (tmp_path / "r/README.txt").write_text("a user's own notes")
    assert list(read_signals(tmp_path / "r").channels) == ["x", "y", "z"]


def test_one_control_holds_for_the_whole_episode(tmp_path: Path) -> None:
    """A single value on a clock of its own, given before the first observation."""
    recording = make_signals(seconds=0.4)
    held = Channel(clock="set", role="control", quantity="command", actuator="motor", unit="rad")
    table = pd.DataFrame({"episode": [0, 1], "t": [0.0, 0.0], "u": [0.5, 0.7]})
    other = dataclasses.replace(
        changed(recording, "main", lambda main: main.drop(columns="u")),
        channels=recording.channels | {"u": held},
    )
    other = dataclasses.replace(other, signals=other.signals | {"set": table})
    write_signals(other, tmp_path / "r")
    pd.testing.assert_frame_equal(read_signals(tmp_path / "r").signals["set"], table)


def test_a_channel_may_be_called_as_columns_of_version_1(tmp_path: Path) -> None:
    """Of these some are texts, and some may be left out."""
    t = np.arange(50) / 100
    names = ("object_id", "yaw", "latent", "hit", "order")
    channels = dict.fromkeys(names, (CHANNELS["q"], t))
    write_signals(SignalRecording.from_arrays(t, channels, rig="r"), tmp_path / "r")
    assert list(read_signals(tmp_path / "r").channels) == list(names)
    table = pq.read_table(tmp_path / "r/signals-main.parquet")
    pq.write_table(table.drop_columns(["yaw"]), tmp_path / "r/signals-main.parquet")
    with pytest.raises(InputError, match="column 'yaw' is missing"):
        read_signals(tmp_path / "r")


def test_each_version_is_told_from_the_other(tmp_path: Path, signals_folder: Path) -> None:
    write_recording(make_recording(), tmp_path / "hits")
    assert format_version(tmp_path / "hits") == 1
    with pytest.raises(InputError) as caught:
        read_signals(tmp_path / "hits")
    assert "format_version is 1 (hits of a sliding object), and this needs a recording of version 2" in str(
        caught.value
    )
    with pytest.raises(InputError) as caught:
        read_recording(signals_folder)
    assert str(caught.value) == (
        f"{signals_folder}/recording.json: format_version is 2 (joints and bodies), and this needs a "
        "recording of version 1 (hits of a sliding object); name such a recording"
    )


def test_main_describes_either(
    tmp_path: Path, signals_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_recording(make_recording(), tmp_path / "hits")
    assert main([str(tmp_path / "hits")]) == 0
    assert "kind           full" in capsys.readouterr().out
    assert main([str(signals_folder)]) == 0
    assert "kind           signals: 4 observed, 1 controlled" in capsys.readouterr().out


def test_existing_folder_is_refused_and_kept(signals_folder: Path) -> None:
    before = {path.name: path.read_bytes() for path in signals_folder.iterdir()}
    with pytest.raises(InputError, match="exists already"):
        write_signals(make_signals(1, seconds=0.4), signals_folder)
    assert {path.name: path.read_bytes() for path in signals_folder.iterdir()} == before


def test_bad_signals_leave_nothing(tmp_path: Path) -> None:
    def spoil(table: pd.DataFrame) -> None:
        table.loc[7, "q"] = np.inf

    with pytest.raises(InputError, match=r"signals-main\.parquet: row 7 .* 'q' is infinite"):
        write_signals(changed(make_signals(seconds=0.4), "main", spoil), tmp_path / "r")
    assert list(tmp_path.iterdir()) == []


def test_interrupted_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(write, "write_parquet", fail)
    with pytest.raises(KeyboardInterrupt):
        write_signals(make_signals(seconds=0.4), tmp_path / "r")
    assert list(tmp_path.iterdir()) == []
