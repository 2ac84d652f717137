"""Readings of which one device's are late: named, with the delay, and nothing else."""

import numpy as np
import pytest
from mujoco import MjSpec
from scipy.interpolate import CubicSpline
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.verdict import Verdict
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

from .mechanisms import PENDULUM, control_channel, joint, place, recording, simulate, with_stamps

EPISODES, SECONDS, INTERVAL = 10, 2.5, 0.01
ROD = PENDULUM.replace('timestep="0.01"', 'timestep="0.002"')


def driven(velocity_late: float = 0.0) -> SignalRecording:
    """The rod's angle and speed, and where its tip is, under a torque of three sines."""
    rng, t = np.random.default_rng(4), np.arange(round(SECONDS / INTERVAL)) * INTERVAL
    read: dict[str, tuple[Channel, list[np.ndarray]]] = {
        "angle": (joint("swing"), []),
        "speed": (joint("swing", "velocity", "rad/s"), []),
        "x": (place("site", "tip", "x"), []),
        "z": (place("site", "tip", "z"), []),
        "drive": (control_channel(actuator="drive"), []),
    }
    for _ in range(EPISODES):
        phase, pace = rng.uniform(0, 2 * np.pi, 3), rng.uniform(1, 6, 3)
        u = np.sin(pace * t[:, None] + phase).sum(1)
        q, v, *_ = simulate(ROD, t, u[:, None], [rng.uniform(-1, 1)], [0.0])
        speed = CubicSpline(t, v[:, 0])(t - velocity_late)
        seen = (q[:, 0], speed, -np.sin(q[:, 0]), -np.cos(q[:, 0]))
        for name, values, sd in zip(read, seen, (1e-3, 1e-2, 1e-3, 1e-3), strict=False):
            read[name][1].append(values + sd * rng.standard_normal(len(t)))
        read["drive"][1].append(u)
    return recording([t] * EPISODES, read)


def verdict_of(made: SignalRecording) -> Verdict:
    return diagnose(made, bind(MjSpec.from_string(ROD), made.channels)).verdict


@pytest.mark.parametrize("late", [0.03, -0.012])
def test_a_camera_whose_clock_is_late(late: float):
    found = verdict_of(with_stamps(driven(), ["x", "z"], late))
    ((effect, part, value),) = [(e.name, e.part, e.parameters[0]) for e in found.effects]
    assert (effect, part) == ("encoder_delay", "clock stamped")
    assert value.low < late < value.high
    assert value.value == pytest.approx(late, abs=2e-4)
    assert not found.unknown.flagged


def test_a_velocity_that_is_filtered():
    found = verdict_of(driven(velocity_late=0.006))
    ((effect, part, variant, value),) = [(e.name, e.part, e.variant, e.parameters[0]) for e in found.effects]
    assert (effect, part, variant) == ("encoder_delay", "swing", "velocity alone")
    assert value.value == pytest.approx(0.006, abs=2e-4)
    assert found.mismatch.strongest == "delay of the readings of swing (velocity alone)"
    assert not found.unknown.flagged
