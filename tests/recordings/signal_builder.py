"""A small valid recording of signals, seeded, for tests of whatever reads one."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

NOISE = {"q": 0.001, "v": 0.02, "seen": 0.004}
RATES = {"main": 500.0, "camera": 60.0}
CHANNELS = {
    "q": Channel(clock="main", role="observation", quantity="position", joint="hinge", unit="rad"),
    "v": Channel(clock="main", role="observation", quantity="velocity", joint="hinge", unit="rad/s"),
    "u": Channel(
        clock="main", role="control", quantity="torque", actuator="motor", unit="N m", hold="linear"
    ),
    "seen": Channel(clock="camera", role="observation", quantity="position", joint="hinge", unit="rad"),
    "free": Channel(clock="camera", role="observation", quantity="force", sensor="cell", unit="N", noise=0.1),
}


def angle(t: np.ndarray, episode: int) -> np.ndarray:
    """Position of the hinge in rad: a sum of sines below 3 Hz, another one in each episode."""
    return 0.8 * np.sin(6.1 * t + episode) + 0.3 * np.cos(13.7 * t) + 0.1 * np.sin(17.0 * t - episode)


def speed(t: np.ndarray, episode: int) -> np.ndarray:
    """Its derivative."""
    return 4.88 * np.cos(6.1 * t + episode) - 4.11 * np.sin(13.7 * t) + 1.7 * np.cos(17.0 * t - episode)


def make_signals(seed: int = 0, seconds: float = 4.0, episodes: int = 2) -> SignalRecording:
    """Two clocks: encoder, tachometer and motor at 500 Hz, a camera and a force at 60 Hz; nothing odd."""
    rng = np.random.default_rng(seed)
    main, camera = [], []
    for episode in range(episodes):
        t = _times(rng, RATES["main"], seconds)
        main.append(
            pd.DataFrame(
                {
                    "episode": episode,
                    "t": t,
                    "q": angle(t, episode) + rng.normal(0, NOISE["q"], len(t)),
                    "v": speed(t, episode) + rng.normal(0, NOISE["v"], len(t)),
                    "u": 0.3 * np.sin(5 * t) + 0.2 * np.cos(11 * t + episode),
                }
            )
        )
        t = 0.01 + _times(rng, RATES["camera"], seconds - 0.02)
        camera.append(
            pd.DataFrame(
                {
                    "episode": episode,
                    "t": t,
                    "seen": angle(t, episode) + rng.normal(0, NOISE["seen"], len(t)),
                    "free": 2 + rng.normal(0, 0.1, len(t)),
                }
            )
        )
    number = np.arange(episodes)
    return SignalRecording(
        rig="test-rig",
        stand_in=True,
        note="made for tests: ü",
        sealed_truth_sha256="0" * 64,
        channels=dict(CHANNELS),
        episodes=pd.DataFrame(
            {
                "episode": number,
                "order": number,
                "recorded_at": pd.date_range(
                    "2026-03-01 10:00", periods=episodes, freq="min", tz="UTC"
                ).as_unit("us"),
                "repeat_of": pd.array([None, *([0] * (episodes - 1))], dtype="Int64"),
            }
        ),
        signals={
            "main": pd.concat(main, ignore_index=True),
            "camera": pd.concat(camera, ignore_index=True),
        },
    )


def _times(rng: np.random.Generator, rate_hz: float, seconds: float) -> np.ndarray:
    """Times at a rate, each late by up to 2 % of the interval, the first one 0."""
    count = round(seconds * rate_hz)
    late = rng.uniform(0, 0.02, count)
    late[0] = 0
    return (np.arange(count) + late) / rate_hz


def changed(
    recording: SignalRecording, clock: str, change: Callable[[pd.DataFrame], pd.DataFrame | None]
) -> SignalRecording:
    """The recording with a changed copy of a clock's table; `change` edits in place or returns another."""
    frame = recording.signals[clock].copy()
    other = change(frame)
    return dataclasses.replace(
        recording, signals=recording.signals | {clock: frame if other is None else other}
    )


def with_channel(recording: SignalRecording, name: str, **changes: Any) -> SignalRecording:
    """The recording with a channel that means something else."""
    channel = Channel.model_validate(recording.channels[name].model_dump() | changes)
    return dataclasses.replace(recording, channels=recording.channels | {name: channel})


def assert_same_signals(a: SignalRecording, b: SignalRecording) -> None:
    """Equal content, to the last bit."""
    for field in dataclasses.fields(a):
        if field.name not in {"episodes", "signals"}:
            assert getattr(a, field.name) == getattr(b, field.name), field.name
    pd.testing.assert_frame_equal(a.episodes, b.episodes, check_exact=True)
    assert set(a.signals) == set(b.signals)
    for clock, table in a.signals.items():
        pd.testing.assert_frame_equal(table, b.signals[clock], check_exact=True)


def write_signal_mapping(file: Path, **changes: Any) -> Path:
    """A mapping of columns time, pos and tau; a change of None leaves its key out."""
    mapping = {
        "format_version": 2,
        "rig": "test-rig",
        "clocks": {"main": {"time": {"column": "time"}}},
        "channels": {
            "q": {
                "column": "pos",
                "role": "observation",
                "quantity": "position",
                "joint": "hinge",
                "unit": "rad",
            },
            "u": {
                "column": "tau",
                "role": "control",
                "quantity": "torque",
                "actuator": "motor",
                "unit": "N m",
            },
        },
        **changes,
    }
    file.write_text(yaml.safe_dump({key: value for key, value in mapping.items() if value is not None}))
    return file
