"""Process force of controls whose stamps err, against impulses that are drawn."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.fit.control_errors import control_errors
from slapshot.diagnosis.fit.noise import FORCE_HOLD_S
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.problem import Problem

from .mechanisms import CART, PENDULUM, control_channel, joint, recording, simulate, with_stamps

ERROR = 6e-4  # s


def problem(model: str, actuator: str, hinge: str, gear: float = 1.0, error: float = ERROR) -> Problem:
    """A joint with a motor, whose command changes from time to time."""
    model = model.replace("<motor", f'<motor gear="{gear}"')
    rng, t = np.random.default_rng(2), np.arange(400) * 0.01
    u = np.sin(2 * t) + np.sin(7 * t + 1)
    qpos = simulate(model, t, u[:, None], [0.1], [0.0])[0]
    channels = {
        "q": (joint(hinge, unit="m" if hinge == "rail" else "rad"), qpos[:, 0]),
        "u": (control_channel(actuator=actuator), u),
    }
    made = with_stamps(recording(t, channels), ["u"], error * rng.standard_normal(400))
    rig = bind(MjSpec.from_string(model), made.channels)
    return Problem.of(rig, made.channels, segment_recording(made, rig))


@pytest.mark.parametrize("gear", [1.0, 2.5])
def test_impulses_are_those_of_changes_at_other_times(gear):
    """A command that changes earlier by a time has acted by so much longer."""
    of = problem(CART, "push", "rail", gear)
    found = control_errors(of.rig, of.segments, of.trajectory, of.torque)
    assert found is not None
    h, sigma = of.segments.interval, of.segments.stamp_error
    assert sigma is not None
    # The command of each node less that of the node before, over segments; nothing is known before the first.
    u = of.segments.controls[0][of.segments.substeps - 1 :: of.segments.substeps, 0]
    whole = np.abs(np.diff(u, prepend=u[0]))
    change = np.stack([whole[first : first + of.segments.shape[1]] for first in of.segments.first])
    assert (change[1:, 0] > 0).all()
    drawn = gear * change * sigma[0] * np.random.default_rng(1).standard_normal((4000, 1, 1))
    impulse = found * of.torque[0] * np.sqrt(FORCE_HOLD_S / h) * h
    # 4000 draws tell a standard deviation to 1.1 %.
    assert impulse == pytest.approx(drawn.std(axis=0), rel=0.05, abs=1e-12)


def test_regular_stamps_have_none():
    of = problem(PENDULUM, "drive", "swing", error=0.0)
    assert control_errors(of.rig, of.segments, of.trajectory, of.torque) is None
    assert of.initial_noise.control_error is None


def test_noise_has_them_and_keeps_them_with_its_segments():
    of = problem(PENDULUM, "drive", "swing")
    noise = of.initial_noise
    assert noise.control_error is not None
    some = np.array([2, 5])
    assert np.array_equal(noise.select(some).control_error, noise.control_error[some])
    without = replace(noise, control_error=None).covariances(of.segments.interval)
    with_them = noise.covariances(of.segments.interval)
    assert without.inflation is None
    assert with_them.inflation == pytest.approx(1 + (noise.control_error / noise.force) ** 2)


def test_a_command_of_a_servo_acts_by_its_stiffness():
    """Twice as stiff, twice the impulse."""
    model = PENDULUM.replace('<motor name="drive"', '<position kp="STIFF" name="drive"')
    found = []
    for stiff in (5, 10):
        of = problem(model.replace("STIFF", str(stiff)), "drive", "swing")
        share = control_errors(of.rig, of.segments, of.trajectory, np.ones(1))
        assert share is not None
        found.append(share)
    assert found[1] == pytest.approx(2 * found[0])
