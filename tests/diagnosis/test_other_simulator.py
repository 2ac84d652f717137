"""A two-link arm by its own equations of motion, not by MuJoCo: a robot takes no steps of any integrator."""

import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.arrays import Array
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.verdict import Verdict
from slapshot.recordings.signals import SignalRecording

from .mechanisms import control_channel, joint, recording, with_stamps

INTERVAL, SECONDS, NOISE = 0.004, 2.0, 3e-4
LENGTH, MASS, CENTRE, INERTIA = 0.35, (3.0, 1.8), (0.18, 0.15), (0.04, 0.02)
ROTOR, DAMPING, GRAVITY = (0.05, 0.03), np.array([0.15, 0.08]), 9.81
NOMINAL = f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <body name="upper">
      <inertial pos="0 0 -{CENTRE[0]}" mass="{MASS[0]}" diaginertia="{INERTIA[0]} {INERTIA[0]} 0.005"/>
      <joint name="shoulder" axis="0 1 0" damping="{DAMPING[0]}" armature="{ROTOR[0]}"/>
      <body name="fore" pos="0 0 -{LENGTH}">
        <inertial pos="0 0 -{CENTRE[1]}" mass="{MASS[1]}" diaginertia="{INERTIA[1]} {INERTIA[1]} 0.003"/>
        <joint name="elbow" axis="0 1 0" damping="{DAMPING[1]}" armature="{ROTOR[1]}"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator>
</mujoco>
"""


def acceleration(q: Array, v: Array, torque: Array) -> Array:
    """Of a double pendulum with relative angles, as in any textbook."""
    (m1, m2), (c1, c2), (i1, i2) = MASS, CENTRE, INERTIA
    coupled = m2 * LENGTH * c2 * np.cos(q[1])
    mass = np.array([
        [i1 + m1 * c1**2 + i2 + m2 * (LENGTH**2 + c2**2) + 2 * coupled + ROTOR[0], i2 + m2 * c2**2 + coupled],
        [i2 + m2 * c2**2 + coupled, i2 + m2 * c2**2 + ROTOR[1]],
    ])  # fmt: skip
    turning = m2 * LENGTH * c2 * np.sin(q[1])
    bias = np.array([-turning * (2 * v[0] * v[1] + v[1] ** 2), turning * v[0] ** 2])
    outer = m2 * c2 * np.sin(q[0] + q[1])
    weight = GRAVITY * np.array([(m1 * c1 + m2 * LENGTH) * np.sin(q[0]) + outer, outer])
    return np.linalg.solve(mass, torque - DAMPING * v - bias - weight)


def recorded(late: int = 0, steps: int = 4, jitter: float = 0.0) -> SignalRecording:
    """Eight episodes; torques act some samples late, and their stamps err by a standard deviation in s.

    By Runge and Kutta's method in steps of 1 ms.
    """
    rng, count, h = np.random.default_rng(5), round(SECONDS / INTERVAL), INTERVAL / steps
    t = np.arange(count) * INTERVAL
    torques, angles = [], []
    for _ in range(8):
        waves = [
            sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip(
                size * rng.uniform(0.5, 1, 3), rng.uniform(0.3, 2.5, 3), rng.uniform(0, 6, 3), strict=True
            )) for size in (4.0, 1.2)
        ]  # fmt: skip
        u = np.stack(waves, axis=1)
        state, seen = np.concatenate([rng.uniform(-0.6, 0.6, 2), np.zeros(2)]), []
        for k in range(count):
            seen.append(state[:2])
            torque = u[max(k - late, 0)]

            def rate(x: Array, torque: Array = torque) -> Array:
                return np.concatenate([x[2:], acceleration(x[:2], x[2:], torque)])

            for _ in range(steps):
                a = rate(state)
                b = rate(state + h / 2 * a)
                c = rate(state + h / 2 * b)
                state = state + h / 6 * (a + 2 * b + 2 * c + rate(state + h * c))
        torques.append(u)
        angles.append(np.array(seen) + NOISE * rng.standard_normal((count, 2)))
    made = recording(
        [t] * 8,
        {
            "u1": (control_channel(actuator="m1"), [u[:, 0] for u in torques]),
            "u2": (control_channel(actuator="m2"), [u[:, 1] for u in torques]),
            "shoulder": (joint("shoulder"), [q[:, 0] for q in angles]),
            "elbow": (joint("elbow"), [q[:, 1] for q in angles]),
        },
    )
    return with_stamps(made, ["u1", "u2"], jitter * rng.standard_normal(8 * count)) if jitter else made


def verdict_on(made: SignalRecording) -> Verdict:
    return diagnose(made, bind(MjSpec.from_string(NOMINAL), made.channels)).verdict


def test_an_arm_that_lacks_nothing_is_no_mismatch_of_a_model_with_coarse_steps():
    found = verdict_on(recorded())
    assert found.headline == "nothing_found"
    assert (
        found.fit.nominal.rms["joint position"].value
        < 1.1 * found.fit.noise_floor.rms["joint position"].value
    )


def test_stamps_of_torques_that_err_are_no_mismatch():
    """By 0.4 ms of 4: torques then change at other times than they say, which no missing physics is."""
    found = verdict_on(recorded(jitter=4e-4))
    assert found.headline == "nothing_found"
    assert found.mismatch is not None
    assert found.mismatch.p_value > 0.1
    predicted, floor = (of.rms["joint position"].value for of in (found.fit.nominal, found.fit.noise_floor))
    assert 0.8 * floor < predicted < 1.15 * floor


def test_torques_that_act_late_are_told():
    """By three samples: but where an episode begins, readings that are late would look alike."""
    found = verdict_on(recorded(late=3))
    (effect,) = found.effects
    assert (effect.name, effect.part) == ("command_delay", "all actuators")
    (delay,) = effect.parameters
    assert delay.value == pytest.approx(3 * INTERVAL, abs=5e-5)
    assert not found.unknown.flagged
