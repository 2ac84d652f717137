"""A whole diagnosis of a carriage on rails, one long episode, from its mass alone.

It is integrated apart from MuJoCo; the encoder is so precise that a model without friction is wrong by
thousands of its standard deviations.
"""

import numpy as np
from mujoco import MjSpec
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.rig import bind

from .mechanisms import control_channel, joint, recording

AXIS = """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody><body>
<joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".1 .1 .05" mass="95.1" contype="0"
conaffinity="0"/></body></worldbody><actuator><motor name="motor" joint="slide"/></actuator></mujoco>"""
MASS, VISCOUS, COULOMB = 95.1, 203.5, 20.4  # of EMPS (Janot, Gautier, Brunot 2019), in kg, N s/m and N
STEP, FINER, NOISE = 0.005, 100, 2e-5


def driven_pendulum(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times in s, positions as read in m, and forces in N that a controller holds from sample to sample."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds / STEP)) * STEP
    wanted = 0.1 * np.sin(1.1 * t) * np.sin(0.31 * t) + 0.05 * np.sin(2.9 * t)
    speed = np.gradient(wanted, STEP)
    q, v = 0.0, 0.0
    read, force = np.empty(len(t)), np.empty(len(t))
    h = STEP / FINER
    for k in range(len(t)):
        read[k] = q + NOISE * rng.standard_normal()
        force[k] = 8000 * (wanted[k] - q) + 1500 * (speed[k] - v)
        for _ in range(FINER):
            a = (force[k] - VISCOUS * v - COULOMB * np.tanh(v / 1e-3)) / MASS
            q += h * v + h * h * a / 2
            v += h * a
    return t, read, force


def test_friction_of_a_precise_axis_is_named():
    t, read, force = driven_pendulum(16.0, 3)
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
