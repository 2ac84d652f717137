"""Whole diagnoses of a carriage on rails, one long episode, from its mass alone.

It is integrated apart from MuJoCo; the encoder is so precise that a model without friction is wrong by
thousands of its standard deviations.
"""

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.rig import bind

from .mechanisms import control_channel, joint, recording

AXIS = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".1 .1 .05" mass="95.1" contype="0"
conaffinity="0"/></body></worldbody><actuator><motor name="motor" joint="slide"/></actuator></mujoco>"""
MASS, VISCOUS, COULOMB = 95.1, 203.5, 20.4  # of EMPS (Janot, Gautier, Brunot 2019), in kg, N s/m and N
FINER = 5e-5  # s


def driven_axis(
    seconds: float,
    seed: int,
    *,
    step: float = 0.005,
    noise: float = 2e-5,
    offset: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times in s, positions as read in m, and forces in N that a controller holds from sample to sample."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds / step)) * step
    wanted = 0.1 * np.sin(1.1 * t) * np.sin(0.31 * t) + 0.05 * np.sin(2.9 * t)
    speed = np.gradient(wanted, step)
    q, v = 0.0, 0.0
    read, force = np.empty(len(t)), np.empty(len(t))
    finer = round(step / FINER)
    h = step / finer
    for k in range(len(t)):
        read[k] = q + noise * rng.standard_normal()
        force[k] = 8000 * (wanted[k] - q) + 1500 * (speed[k] - v)
        for _ in range(finer):
            free = v + h * (force[k] + offset - VISCOUS * v) / MASS
            # Dry friction stops the carriage, or slows it down by as much as it can within a step.
            before, v = v, np.sign(free) * max(abs(free) - h * COULOMB / MASS, 0.0)
            q += h * (before + v) / 2
    return t, read, force


def test_friction_of_a_precise_axis_is_named():
    t, read, force = driven_axis(16.0, 3)
    channels = {"q": (joint("slide", unit="m"), read), "u": (control_channel("N", actuator="motor"), force)}
    made = recording(t, channels)
    verdict = diagnose(made, bind(MjSpec.from_string(AXIS), made.channels), seed=1).verdict
    assert verdict.headline == "found"
    assert not verdict.unknown.flagged
    values = {effect.name: effect.parameters[0] for effect in verdict.effects}
    assert set(values) == {"coulomb_friction", "viscous_friction"}
    for name, true in (("coulomb_friction", COULOMB), ("viscous_friction", VISCOUS)):
        found = values[name]
        sd = (found.high - found.low) / (2 * 1.645)
        assert abs(found.value - true) < 4 * sd
        assert sd < 0.02 * true


@pytest.mark.slow
def test_an_offset_beside_friction_at_a_fast_clock():
    """1 kHz and 2 microns: what the model lacks is wrong by tens of thousands of standard deviations."""
    offset = 3.2
    t, read, force = driven_axis(12.0, 4, step=0.001, noise=2e-6, offset=offset)
    channels = {"q": (joint("slide", unit="m"), read), "u": (control_channel("N", actuator="motor"), force)}
    made = recording(t, channels)
    verdict = diagnose(made, bind(MjSpec.from_string(AXIS), made.channels), seed=1).verdict
    assert verdict.headline == "found"
    values = {effect.name: [p.value for p in effect.parameters] for effect in verdict.effects}
    assert values["viscous_friction"] == pytest.approx([VISCOUS], rel=0.01)
    assert values["direction_friction"] == pytest.approx([COULOMB - offset, COULOMB + offset], rel=0.02)
