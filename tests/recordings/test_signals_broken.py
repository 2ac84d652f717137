"""Every way to break a recording of signals that we thought of, and random damage for the others."""

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slapshot.errors import InputError
from slapshot.recordings.signals import read_signals, write_signals

from .breakers import Breaker, both, empty_folder, header, remove_folder, text, without
from .builder import make_recording
from .signal_builder import assert_same_signals, make_signals

SECONDS = 0.4  # 200 rows of main an episode, 23 of camera


def small() -> Any:
    return make_signals(seconds=SECONDS)


@pytest.fixture(scope="module")
def valid_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("valid") / "r"
    write_signals(small(), folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def folder(tmp_path: Path, valid_files: dict[str, bytes]) -> Path:
    return put(valid_files, tmp_path / "recording")


def put(files: dict[str, bytes], folder: Path) -> Path:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def table(name: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> Breaker:
    """Breaks one table as a user with pandas would; `change` edits in place or returns another."""

    def breaker(folder: Path) -> None:
        frame = pd.read_parquet(folder / f"{name}.parquet")
        changed = change(frame)
        (frame if changed is None else changed).to_parquet(folder / f"{name}.parquet", index=False)

    return breaker


def cell(name: str, row: int, column: str, value: Any) -> Breaker:
    def change(frame: pd.DataFrame) -> None:
        frame.loc[row, column] = value

    return table(name, change)


def times(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Breaker:
    return table(name, lambda frame: frame.assign(t=change(frame["t"].to_numpy())))


def channel(name: str, **changes: Any) -> Breaker:
    """Sets keys of a channel; None removes one, and a channel of None removes it whole."""

    def breaker(folder: Path) -> None:
        content = json.loads((folder / "recording.json").read_text())
        values = content["channels"].pop(name, {})
        values.update(changes)
        content["channels"][name] = {key: value for key, value in values.items() if value is not None}
        (folder / "recording.json").write_text(json.dumps(content))

    return breaker


def no_channel(*names: str) -> Breaker:
    def breaker(folder: Path) -> None:
        content = json.loads((folder / "recording.json").read_text())
        for name in names:
            del content["channels"][name]
        (folder / "recording.json").write_text(json.dumps(content))

    return breaker


def without_episode(name: str, episode: int) -> Breaker:
    return table(name, lambda frame: frame[frame["episode"] != episode])


def swap_times(frame: pd.DataFrame) -> None:
    frame.loc[[13, 14], "t"] = frame.loc[[14, 13], "t"].to_numpy()


def same_time(frame: pd.DataFrame) -> None:
    frame.loc[14, "t"] = frame.loc[13, "t"]


def blind_second_episode(frame: pd.DataFrame) -> None:
    frame.loc[frame["episode"] == 1, ["seen", "free"]] = np.nan


def hits_file(folder: Path) -> None:
    make_recording().hits.to_parquet(folder / "episodes.parquet", index=False)


QUATERNION = {
    "role": "observation",
    "quantity": "position",
    "body": "ball",
    "unit": "1",
    "clock": "camera",
}


def quaternion(size: float, *parts: str) -> Breaker:
    """Components of a quaternion of the given length, as channels and columns."""

    def breaker(folder: Path) -> None:
        frame = pd.read_parquet(folder / "signals-camera.parquet")
        for part in parts:
            channel(part, component=part, **QUATERNION)(folder)
        frame[list(parts)] = size / 2
        frame.to_parquet(folder / "signals-camera.parquet", index=False)

    return breaker


def own_clock(t: list[float]) -> Breaker:
    """The control on a clock of its own, with these times in each episode."""

    def breaker(folder: Path) -> None:
        channel("u", clock="set")(folder)
        table("signals-main", lambda frame: frame.drop(columns="u"))(folder)
        rows = pd.DataFrame({"episode": np.repeat([0, 1], len(t)), "t": t * 2, "u": 0.5})
        rows.to_parquet(folder / "signals-set.parquet", index=False)

    return breaker


MAIN, CAMERA, EPISODES = "signals-main", "signals-camera", "episodes"

CASES: dict[str, tuple[Breaker, list[str]]] = {
    "folder missing": (remove_folder, ["recording: folder is missing"]),
    "folder empty": (empty_folder, ["recording: folder is empty"]),
    # recording.json
    "no header": (without("recording.json"), ["recording.json: no such file"]),
    "not JSON": (text("{rig: 3"), ["recording.json: is not valid JSON"]),
    "next version": (header(format_version=3), ["format_version is 3, but this slapshot reads version 1, 2"]),
    "version missing": (header(format_version=None), ["key 'format_version' is missing"]),
    "key unknown": (header(camera_rate_hz=50.0), ["unknown key 'camera_rate_hz'; remove it"]),
    "key missing": (header(rig=None), ["key 'rig' is missing; add it (name of the set-up)"]),
    "no channels": (header(channels={}), ["channels: is empty; add at least 1"]),
    "channel key unknown": (
        channel("q", units="rad"),
        ["channels.q.units: unknown key 'units'; write 'unit'"],
    ),
    "channel key missing": (channel("q", role=None), ["channels.q: key 'role' is missing; add it (control:"]),
    "role unknown": (
        channel("q", role="input"),
        ["channels.q.role: 'input' is not allowed; use one of: control"],
    ),
    "quantity unknown": (
        channel("q", quantity="angle"),
        ["'angle' is not allowed; use one of: position, velocity"],
    ),
    "name of a channel": (
        channel("q 1", clock="main", role="observation", quantity="force", unit="N"),
        ["channels.q 1", "letters, digits, _ and -"],
    ),
    "name of a clock": (channel("q", clock="../a"), ["channels.q.clock: '../a' is not allowed; use letters"]),
    "reserved name": (
        channel("t", clock="main", role="observation", quantity="force", unit="N"),
        ["channels.t: 't' is a column of every table; give the channel another name"],
    ),
    "name twice": (
        text('{"format_version": 2, "channels": {"q": {}, "q": {}}}'),
        ["key 'q' stands there twice"],
    ),
    "two targets": (channel("q", site="tip"), ["channels.q: names both joint and site; keep the one"]),
    "component of a site": (
        channel("q", joint=None, site="tip"),
        ["channels.q: key 'component' is missing; say which of x, y, z"],
    ),
    "component unknown": (channel("q", component="roll"), ["channels.q.component: 'roll' is not allowed"]),
    "component of an actuator": (channel("u", component="x"), ["component: 'x' cannot be of an actuator"]),
    "quaternion's velocity": (
        channel("v", component="qw"),
        ["channels.v.component: 'qw' is of positions; a velocity has x, y and z"],
    ),
    "command of a joint": (
        channel("u", actuator=None, joint="hinge", quantity="command"),
        ["channels.u.quantity: 'command' is of actuators, not of a joint; name the actuator"],
    ),
    "control by a sensor": (
        channel("free", role="control"),
        ["channels.free.role: 'control' cannot be, a sensor measures; write observation"],
    ),
    "hold of an observation": (
        channel("q", hold="linear"),
        ["channels.q.hold: 'linear' is of controls, and this is an observation; remove it"],
    ),
    "noise of nothing": (channel("q", noise=0), ["channels.q.noise: 0 is out of range; it must be > 0"]),
    "degrees": (
        channel("q", unit="deg"),
        ["channels.q.unit: 'deg' is not SI; multiply the values by 0.01745329252 and write 'rad'"],
    ),
    "revolutions": (
        channel("v", unit="rpm"),
        ["channels.v.unit: 'rpm' is not SI; multiply the values by 0.1047197551 and write 'rad/s'"],
    ),
    "millinewton metres": (
        channel("u", unit="mNm"),
        ["channels.u.unit: 'mNm' is not SI; multiply the values by 0.001 and write 'N m'"],
    ),
    "milliseconds": (
        channel("q", unit="ms"),
        ["channels.q.unit: 'ms' is no unit of a position; times stand in column t; write 'rad' or 'm'"],
    ),
    "spelling of a unit": (
        channel("u", unit="Nm"),
        ["channels.u.unit: 'Nm' is not how it is spelt here; write 'N m'"],
    ),
    "unit of another quantity": (
        channel("q", unit="rad/s"),
        ["channels.q.unit: 'rad/s' is no unit of a position; write 'rad' or 'm'"],
    ),
    "angle of a place": (
        both(channel("q", component="x")),
        ["channels.q.unit: 'rad' is no unit of a place; write 'm'"],
    ),
    "unit unknown": (
        channel("q", unit="furlong"),
        ["'furlong' is no unit of a position; write 'rad' or 'm'"],
    ),
    "no observation": (
        no_channel("q", "v", "seen", "free"),
        ["channels: has no observation; add what was measured"],
    ),
    "two controls": (
        channel("w", clock="main", role="control", quantity="command", actuator="motor", unit="1"),
        ["channels.w: controls the same as 'u' (torque of actuator motor); keep one"],
    ),
    "clocks in other case": (
        channel("free", clock="Camera"),
        ["channels.free.clock: 'Camera' differs from clock 'camera' only in case"],
    ),
    "half a quaternion": (
        quaternion(1.0, "qw", "qz"),
        ["channels.qw: is part of a quaternion without qx, qy; add it, on the same clock"],
    ),
    "quaternion of another length": (
        quaternion(2.0, "qw", "qx", "qy", "qz"),
        ["signals-camera.parquet: quaternion qw, qx, qy, qz has a length of 2 (median), not 1"],
    ),
    # Files and columns
    "no episodes file": (
        without("episodes.parquet"),
        ["episodes.parquet: is missing: add the table of episodes"],
    ),
    "no table of a clock": (
        without("signals-camera.parquet"),
        ["signals-camera.parquet: is missing: add a table with columns episode, t, seen, free"],
    ),
    "clock without a channel": (
        no_channel("seen", "free"),
        ["signals-camera.parquet: no channel in recording.json is on clock 'camera'"],
    ),
    "channel without a column": (
        table(MAIN, lambda frame: frame.drop(columns="q")),
        ["signals-main.parquet: column 'q' is missing: add it (position of joint hinge, in rad)"],
    ),
    "column without a channel": (
        no_channel("v"),
        ["signals-main.parquet: column 'v' is not in the format: describe it as a channel of clock 'main'"],
    ),
    "hits for episodes": (hits_file, ["episodes.parquet: column 'episode' is missing"]),
    "text for numbers": (
        table(MAIN, lambda frame: frame.astype({"q": str})),
        ["signals-main.parquet: column 'q' has type", "not a float: convert it"],
    ),
    "garbage": (
        lambda folder: (folder / "signals-main.parquet").write_bytes(b"t,q\n0,1\n") and None,
        ["signals-main.parquet: cannot be read as Parquet"],
    ),
    "fraction of an episode": (
        table(MAIN, lambda frame: frame.assign(episode=frame["episode"] + 0.5)),
        ["signals-main.parquet: row 0 ", "'episode' is 0.5, not a whole number"],
    ),
    # Episodes
    "no episodes": (table(EPISODES, lambda frame: frame[:0]), ["episodes.parquet: has no episodes"]),
    "episode twice": (
        cell(EPISODES, 1, "episode", 0),
        ["episodes.parquet: row 1 (the first is 0): episode 0 is duplicated"],
    ),
    "repeat of nothing": (
        table(EPISODES, lambda frame: frame.assign(repeat_of=[None, 7])),
        ["episodes.parquet: row 1", "episode 1: repeat_of is 7, which is no other episode"],
    ),
    "repeat of itself": (
        table(EPISODES, lambda frame: frame.assign(repeat_of=[0, None])),
        ["episode 0: repeat_of is 0, which is no other episode"],
    ),
    "date of another counter": (
        table(EPISODES, lambda frame: frame.assign(recorded_at=pd.Timestamp("1970-01-02", tz="UTC"))),
        ["row 0 (the first is 0), episode 0: recorded_at is not between 1990 and 2100"],
    ),
    "order missing": (
        table(EPISODES, lambda frame: frame.drop(columns="order")),
        ["episodes.parquet: column 'order' is missing"],
    ),
    "episode not listed": (
        table(EPISODES, lambda frame: frame.assign(repeat_of=None)[:1]),
        ["signals-main.parquet: row 200 (the first is 0): episode 1 is not in episodes.parquet"],
    ),
    "episode missing from a clock": (
        without_episode(CAMERA, 1),
        ["signals-camera.parquet: has no rows of episode 1: add them"],
    ),
    # Times
    "time backwards": (
        table(MAIN, swap_times),
        ["signals-main.parquet: row 14 (the first is 0), episode 0: time goes backwards"],
    ),
    "time twice": (table(MAIN, same_time), ["row 14 (the first is 0), episode 0: the same time twice"]),
    "time before the start": (
        cell(MAIN, 0, "t", -0.001),
        ["row 0", "t is -0.001 s, before the episode's start"],
    ),
    "time missing": (cell(MAIN, 3, "t", np.nan), ["row 3 (the first is 0), column 't' is empty"]),
    "stamps of a clock": (
        both(times(MAIN, lambda t: t + 2000), times(CAMERA, lambda t: t + 2000)),
        ["signals-main.parquet: column 't': episodes begin at 2000 s (median), not near 0"],
    ),
    "unix stamps": (times(MAIN, lambda t: t + 1.7e9), ["t is 1.7e+09, beyond what a time"]),
    "milliseconds for t": (
        both(times(MAIN, lambda t: 1000 * t), times(CAMERA, lambda t: 1000 * t)),
        ["signals-main.parquet: column 't': samples are 2", "too rare for seconds: if t is in milliseconds"],
    ),
    "one row an episode": (
        table(CAMERA, lambda frame: frame.groupby("episode", as_index=False).first()),
        ["signals-camera.parquet: has one row of each episode at most"],
    ),
    "no rows": (table(CAMERA, lambda frame: frame[:0]), ["signals-camera.parquet: has no rows"]),
    "clocks that disagree": (
        times(CAMERA, lambda t: t + 5),
        ["signals-camera.parquet: episode 0: goes from 5.01", "but clock 'main' from 0 to 0.39", "same zero"],
    ),
    "controls that begin late": (
        own_clock([0.1, 0.2]),
        ["signals-set.parquet: episode 0: controls begin at 0.1 s, but observations at 0 s"],
    ),
    "controls of another time": (
        both(own_clock([0.0, 0.001]), times(MAIN, lambda t: t + 3), times(CAMERA, lambda t: t + 3)),
        ["signals-set.parquet: episode 0: controls are given from 0 to 0.001 s, but observations from 3"],
    ),
    "controls in milliseconds": (
        own_clock([0.0, 100.0, 200.0]),
        [
            "signals-set.parquet: episode 0: controls are given from 0 to 200 s, but observations",
            "in seconds",
        ],
    ),
    # Values
    "infinite": (
        cell(MAIN, 5, "q", np.inf),
        ["signals-main.parquet: row 5 (the first is 0), column 'q' is infinite"],
    ),
    "memory": (cell(MAIN, 5, "q", 1e160), ["row 5 (the first is 0), episode 0: q is 1e+160, beyond what"]),
    "control missing": (
        cell(MAIN, 210, "u", np.nan),
        ["signals-main.parquet: row 210 (the first is 0), episode 1: control 'u' is empty (null or NaN)"],
    ),
    "channel without a value": (
        table(MAIN, lambda frame: frame.assign(v=np.nan)),
        ["signals-main.parquet: channel 'v' has no value in any row"],
    ),
    "episode without observation": (
        table(CAMERA, blind_second_episode),
        ["signals-camera.parquet: episode 1 has no observation on this clock"],
    ),
}


@pytest.mark.parametrize(("breaker", "words"), CASES.values(), ids=CASES)
def test_broken(folder: Path, breaker: Breaker, words: list[str]) -> None:
    breaker(folder)
    with pytest.raises(InputError) as caught:
        read_signals(folder)
    message = str(caught.value)
    assert message.startswith(str(folder))
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_quaternion_is_read(folder: Path) -> None:
    quaternion(1.0, "qw", "qx", "qy", "qz")(folder)
    assert read_signals(folder).channels["qz"].of == "position qz of body ball"


def test_column_twice(folder: Path) -> None:
    old = pq.read_table(folder / "signals-main.parquet")
    pq.write_table(old.append_column("q", old["q"]), folder / "signals-main.parquet")
    with pytest.raises(InputError, match=r"signals-main\.parquet: column 'q' is duplicated"):
        read_signals(folder)


def test_null_that_is_no_nan_is_missing(folder: Path) -> None:
    """pyarrow, unlike pandas, tells them apart."""
    old = pq.read_table(folder / "signals-main.parquet")
    for empty in (
        pa.array([None] + [1.0] * (old.num_rows - 1)),
        pa.array([np.nan] + [1.0] * (old.num_rows - 1)),
    ):
        table = old.set_column(old.schema.get_field_index("v"), "v", empty)
        pq.write_table(table, folder / "signals-main.parquet")
        assert np.isnan(read_signals(folder).signals["main"]["v"].iloc[0])


@settings(max_examples=150)
@given(
    name=st.sampled_from(
        ["recording.json", "episodes.parquet", "signals-main.parquet", "signals-camera.parquet"]
    ),
    position=st.floats(0, 1, exclude_max=True),
    byte=st.none() | st.integers(1, 255),
)
def test_random_damage(valid_files: dict[str, bytes], name: str, position: float, byte: int | None) -> None:
    """One byte changed, or everything from there cut off: an InputError, or the same tables.

    A changed digit or letter in recording.json may be another valid recording, so only tables are compared.
    """
    with tempfile.TemporaryDirectory() as parent:
        folder = put(valid_files, Path(parent) / "r")
        raw = bytearray(valid_files[name])
        index = int(position * len(raw))
        if byte is None:
            del raw[index:]
        else:
            raw[index] ^= byte
        (folder / name).write_bytes(raw)
        try:
            damaged = read_signals(folder)
        except InputError:
            return
        if name == "recording.json":
            assert list(damaged.signals["main"]["t"]) == list(small().signals["main"]["t"])
        else:
            assert_same_signals(damaged, small())
