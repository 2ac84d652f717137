"""What is odd in signals: each oddity is put into good ones, and must be told alone, with its numbers."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, filtfilt, lfilter
from slapshot.recordings.quality_warning import WarningKind
from slapshot.recordings.signal_quality import signal_warnings
from slapshot.recordings.signal_statistics import all_channel_statistics
from slapshot.recordings.signals import SignalRecording
from slapshot.recordings.summary import describe_signals

from .signal_builder import RATES, angle, changed, make_signals, speed, with_channel

Change = Callable[[SignalRecording], SignalRecording]


def found(recording: SignalRecording) -> dict[WarningKind, str]:
    """Kind -> text of what is odd."""
    return {
        finding.kind: str(finding)
        for finding in signal_warnings(recording, all_channel_statistics(recording))
    }


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_odd_in_good_signals(seed: int) -> None:
    assert found(make_signals(seed)) == {}


def of_main(change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> Change:
    return lambda recording: changed(recording, "main", change)


def cell(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Changes a column of the clock main, of both episodes at once."""
    return of_main(lambda table: table.assign(**{name: change(table[name].to_numpy().copy())}))


def rounded(step: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.round(x / step) * step


def missing(x: np.ndarray) -> np.ndarray:
    x[300:400] = np.nan
    return x


def lost_rows(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(index=table.index[300:380])


def uneven(table: pd.DataFrame) -> None:
    late = np.random.default_rng(3).uniform(0, 0.8, len(table))
    late[[0, 2000]] = 0
    table["t"] += late / RATES["main"]
    # Measured then, and not only written down: nothing else is odd.
    table["q"] += angle_at(table) - angle_at(make_signals().signals["main"])
    table["v"] += speed_at(table) - speed_at(make_signals().signals["main"])


def angle_at(table: pd.DataFrame) -> np.ndarray:
    return np.concatenate([angle(rows["t"].to_numpy(), int(e)) for e, rows in table.groupby("episode")])


def speed_at(table: pd.DataFrame) -> np.ndarray:
    return np.concatenate([speed(rows["t"].to_numpy(), int(e)) for e, rows in table.groupby("episode")])


def frozen(x: np.ndarray) -> np.ndarray:
    x[505:545] = x[504]  # v = 4 rad/s there
    return x


def held(x: np.ndarray) -> np.ndarray:
    return np.repeat(x[::2], 2)


def spiked(x: np.ndarray) -> np.ndarray:
    x[[400, 900, 2500]] += 0.5
    return x


def slipped(x: np.ndarray) -> np.ndarray:
    x[1000:2000] += 0.1
    return x


def wrapped(x: np.ndarray) -> np.ndarray:
    return (x + 2.5 + np.pi) % (2 * np.pi) - np.pi


def clipped(x: np.ndarray) -> np.ndarray:
    return np.clip(x, -0.4, 0.4)


def late_times(table: pd.DataFrame) -> None:
    """Times that err by 1 ms, which nobody sees in the intervals of a clock that counts."""
    rng = np.random.default_rng(4)
    err = rng.normal(0, 1e-3, len(table))
    table["q"] += angle_at(table.assign(t=table["t"] + err)) - angle_at(table)


def slow_frames(recording: SignalRecording) -> SignalRecording:
    """A camera at 15 Hz without noise: between its frames the joint turns back."""
    table = recording.signals["camera"].iloc[::4]
    seen = angle_at(table)
    return changed(recording, "camera", lambda _: table.assign(seen=seen))


def quotient(recording: SignalRecording) -> SignalRecording:
    """A velocity that is the difference quotient of q."""

    def change(table: pd.DataFrame) -> None:
        by = table.groupby("episode")
        table["v"] = (by["q"].diff() / by["t"].diff()).bfill()

    return changed(recording, "main", change)


def smoothed(recording: SignalRecording) -> SignalRecording:
    """That, behind a low-pass of 40 Hz, and rounded to 0.01 rad/s."""
    b, a = butter(2, 40, fs=RATES["main"])
    raw = quotient(recording)
    return changed(
        raw, "main", lambda table: table.assign(v=rounded(0.01)(lfilter(b, a, table["v"].to_numpy())))
    )


def smoothed_slowly(recording: SignalRecording) -> SignalRecording:
    """The quotient behind a filter of 5 Hz, forward and backward."""
    b, a = butter(4, 5, fs=RATES["main"])
    raw = quotient(recording)
    return changed(raw, "main", lambda table: table.assign(v=filtfilt(b, a, table["v"].to_numpy())))


def behind(recording: SignalRecording, seconds: float) -> SignalRecording:
    """A tachometer that is late."""

    def change(table: pd.DataFrame) -> None:
        table["v"] += speed_at(table.assign(t=table["t"] - seconds)) - speed_at(table)

    return changed(recording, "main", change)


def camera_clock(recording: SignalRecording, offset: float, rate: float) -> SignalRecording:
    """A camera whose clock shows offset + (1 + rate) t at time t."""

    def change(table: pd.DataFrame) -> None:
        true = (table["t"] - offset) / (1 + rate)
        table["seen"] += angle_at(table.assign(t=true)) - angle_at(table)

    return changed(recording, "camera", change)


CASES: dict[str, tuple[WarningKind, Change, list[str]]] = {
    "gaps of a clock": ("gaps", of_main(lost_rows), ["clock main has gaps", "up to 0.16 s at a time"]),
    "gaps of a channel": ("gaps", cell("q", missing), ["q has gaps", "up to 0.2 s at a time"]),
    "uneven clock": ("uneven_clock", of_main(uneven), ["clock main scatter by 33%"]),
    "constant control": (
        "constant_control",
        cell("u", lambda x: 0 * x + 0.2),
        ["u never changes from 0.2 N m"],
    ),
    "constant channel": ("constant_channel", cell("v", lambda x: 0 * x), ["v reads 0 rad/s in all 4000"]),
    "stuck": ("stuck_samples", cell("q", frozen), ["q stands still 1 times, 40 samples", "(episode 0)"]),
    "stuck on a grid": (
        "stuck_samples",
        cell("q", lambda x: frozen(rounded(0.0004)(x))),
        ["40 samples", "(episode 0)"],
    ),
    "repeated": ("repeated_samples", cell("q", held), ["50% of the samples of q", "read 250 times a second"]),
    "outliers": ("outliers", cell("v", spiked), ["3 of 4000 samples of v", "(episodes 0, 1)"]),
    "jump": ("jumps", cell("q", slipped), ["q jumps 1 times", "(episode 0)"]),
    "wrap": ("wraps", cell("q", wrapped), ["q jumps by a whole turn", "(episodes 0, 1)"]),
    "saturated control": (
        "saturated",
        cell("u", clipped),
        ["samples of u sit at its largest", "smallest value, -0.4"],
    ),
    "noise as told": (
        "noise_differs",
        lambda recording: with_channel(recording, "q", noise=0.0001),
        ["noise of q is said to be 0.0001 rad", "scatter by 0.001"],
    ),
    "counts without a sign": (
        "unsigned",
        cell("u", lambda x: np.round(x / 0.001) % 2**16 * 0.001),
        ["samples of u are just below 65.536 N m, 2^16 steps"],
    ),
    "counts without a sign, turned round": (
        "unsigned",
        cell("u", lambda x: -(np.round(x / 0.001) % 2**16) * 0.001),
        ["samples of u are just below 65.536 N m, 2^16 steps"],
    ),
    "times that err": ("moving_noise", of_main(late_times), ["q scatters by", "times erred by 0.98 ms"]),
    "too few frames": ("coarse_sampling", slow_frames, ["seen is undersampled"]),
    "quotient": (
        "no_own_velocity",
        quotient,
        ["v looks like the difference quotient of q: 100% of its noise"],
    ),
    "filtered quotient": ("no_own_velocity", smoothed, ["v looks like the difference quotient of q"]),
    "slowly filtered quotient": (
        "no_own_velocity",
        smoothed_slowly,
        ["v looks like the difference quotient of q"],
    ),
    "velocity in degrees": ("scale_differs", cell("v", np.rad2deg), ["v is 57.", "times the change of q"]),
    "velocity turned round": ("scale_differs", cell("v", np.negative), ["v is -1 times the change of q"]),
    "late velocity": (
        "late_channel",
        lambda recording: behind(recording, 0.008),
        ["v is 8", "ms", "later than q"],
    ),
    "late camera": (
        "late_channel",
        lambda recording: camera_clock(recording, 0.05, 0.0),
        ["seen is 5", "later than q"],
    ),
    "same episodes": (
        "same_episodes",
        lambda recording: dataclasses.replace(
            recording,
            signals={
                clock: pd.concat(
                    [rows := table[table["episode"] == 0], rows.assign(episode=1)], ignore_index=True
                )
                for clock, table in recording.signals.items()
            },
        ),
        ["2 of 2 episodes", "(episodes 0, 1)"],
    ),
    "same place in order": (
        "order_repeats",
        lambda recording: dataclasses.replace(recording, episodes=recording.episodes.assign(order=0)),
        ["2 of 2 episodes have the same order of execution"],
    ),
}
# What goes with it of necessity: a velocity that was smoothed is late, too.
BESIDES: dict[str, set[WarningKind]] = {
    "filtered quotient": {"late_channel"},
    "repeated": {"moving_noise"},  # as if its times erred
    "times that err": {"outliers", "jumps"},  # by up to two intervals
}


@pytest.mark.parametrize(("kind", "change", "words"), CASES.values(), ids=CASES)
def test_an_oddity_is_told_alone(
    request: pytest.FixtureRequest, kind: WarningKind, change: Change, words: list[str]
) -> None:
    kinds = found(change(make_signals()))
    assert kind in kinds
    for word in words:
        assert word in kinds[kind]
    assert set(kinds) - BESIDES.get(request.node.callspec.id, set()) == {kind}


@pytest.mark.parametrize("rate", [2e-3, -2e-3])
def test_a_clock_that_drifts_is_told_with_its_rate(rate: float) -> None:
    """Over 12 s it loses or gains 24 ms, more than an interval of the camera."""
    good = make_signals(seconds=12.0)
    assert found(good) == {}
    kinds = found(camera_clock(good, 0.0, rate))
    assert "clock_drift" in kinds
    said = float(kinds["clock_drift"].split("drifts by ")[1].split(" ms")[0])
    assert said == pytest.approx(1000 * rate, rel=0.15)


def test_controls_that_end_early_are_told() -> None:
    recording = make_signals()
    control = with_channel(recording, "u", clock="control")
    table = recording.signals["main"]
    short = table[table["t"] < 3.5][["episode", "t", "u"]]
    split = dataclasses.replace(
        control,
        signals={"main": table.drop(columns="u"), "control": short, "camera": recording.signals["camera"]},
    )
    assert set(found(split)) == {"controls_end"}
    assert "up to 0.5 s before the observations (episodes 0, 1)" in found(split)["controls_end"]


@pytest.mark.parametrize(("every", "told"), [(1, True), (97, False)])
def test_controls_that_are_lost_for_a_while_are_told_but_not_commands_that_are_held(
    every: int, told: bool
) -> None:
    recording = make_signals()
    control = with_channel(recording, "u", clock="control")
    table = recording.signals["main"]
    lost = table[(table["t"] < 1.0) | (table["t"] > 1.4)][["episode", "t", "u"]]
    if every > 1:  # written when they change
        rng = np.random.default_rng(0)
        lost = table[["episode", "t", "u"]][(rng.uniform(size=len(table)) < 1 / every) | (table["t"] == 0)]
    split = dataclasses.replace(
        control,
        signals={"main": table.drop(columns="u"), "control": lost, "camera": recording.signals["camera"]},
    )
    assert set(found(split)) == ({"gaps"} if told else set())
    assert not told or "controls of clock control have gaps" in found(split)["gaps"]


def test_what_resembles_an_oddity_is_none() -> None:
    """Coarse encoders at rest, commands in steps, a joint that meets its stop slowly, impacts."""
    recording = make_signals()
    t = recording.signals["main"]["t"].to_numpy()
    rng = np.random.default_rng(0)

    def resting(table: pd.DataFrame) -> None:
        table["q"] = rounded(0.004)(1 - np.exp(-3 * t) + rng.normal(0, 1e-4, len(t)))
        table["v"] = 3 * np.exp(-3 * t) + rng.normal(0, 0.02, len(t))
        table["u"] = np.where(t % 1 < 0.5, 1.0, -1.0)

    def struck(table: pd.DataFrame) -> None:
        hit = t > 2
        table["q"] = np.where(hit, 2 * (t - 2), 0.0) + rng.normal(0, 1e-3, len(t))
        table["v"] = 2.0 * hit + rng.normal(0, 0.02, len(t))

    for change in (resting, struck):
        other = changed(recording, "main", change)
        signals = {"main": other.signals["main"]}
        channels = {name: other.channels[name] for name in "qvu"}
        alone = dataclasses.replace(other, signals=signals, channels=channels)
        assert found(alone) == {}


def test_the_description_has_a_line_a_fact() -> None:
    recording = make_signals()
    text = describe_signals(recording, all_channel_statistics(recording))
    lines = text.splitlines()
    assert lines[0] == "rig            test-rig: stand-in (simulated), not a real robot"
    assert lines[1] == "kind           signals: 4 observed, 1 controlled"
    assert "2, 8.0 s, 4 s an episode (median), 1 of them repeats, 2026-03-01 10:00" in lines[2]
    assert lines[3].startswith("clock          main: 500")
    assert [line.split()[0] for line in lines[5:]] == ["channel", "q", "v", "u", "seen", "free"]
    assert lines[6].endswith("observation, position of joint hinge")
