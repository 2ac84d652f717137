"""What has a state of its own is compared with laws fairly: its first states are no freer than they move."""

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.rig import bind

from .mechanisms import PENDULUM, joint, recording, simulate, told

COMPLIANCE = 2e-3  # rad/(N m)
# A rod on a plate that tilts, of an inertia that hardly matters.
SOFT = (
    PENDULUM.replace(
        '<body name="rod">',
        f'<body><joint name="tilt" axis="0 1 0" stiffness="{1 / COMPLIANCE}" damping="1"/>'
        '<inertial mass="0.01" pos="0 0 0" diaginertia="0.01 0.01 0.01"/><body name="rod">',
    )
    .replace("</worldbody>", "</body></worldbody>")
    .replace('timestep="0.01" integrator="implicitfast"', 'timestep="0.0005" integrator="RK4"')
)


@pytest.fixture(scope="module")
def taken():
    """Ten episodes of the rod, whose encoder does not see the plate tilt."""
    rng, t = np.random.default_rng(3), np.arange(0, 2, 0.01)
    model = mujoco.MjModel.from_xml_string(SOFT)
    readings, commands = [], []
    for _ in range(10):
        u = rng.uniform(2, 4) * np.sin(rng.uniform(3, 12) * t + rng.uniform(0, 2 * np.pi))
        q, *_ = simulate(model, t, u[:, None], [0.0, 0.0], [0.0, 0.0])
        readings.append(q[:, 1] + 1e-3 * rng.normal(size=len(t)))
        commands.append(u)
    return recording([t] * 10, {"q": (joint("swing"), readings), "u": (told(actuator="drive"), commands)})


def test_a_soft_base_is_named_and_measured(taken):
    rig = bind(MjSpec.from_string(PENDULUM), taken.channels)
    verdict = diagnose(taken, rig).verdict
    assert [effect.name for effect in verdict.effects] == ["base_compliance"]
    compliance = verdict.effects[0].parameters[0]
    # The interval is of 90 %: half as wide again holds it but once in a hundred.
    half = (compliance.high - compliance.low) / 2
    assert abs(compliance.value - COMPLIANCE) < 1.57 * half < 0.2 * COMPLIANCE
    assert not verdict.unknown.flagged
