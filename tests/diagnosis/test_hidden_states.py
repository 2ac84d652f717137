"""What has a state of its own is compared with laws fairly: its first states are no freer than they move."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis import held_out
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.problem import Problem

from .mechanisms import PENDULUM, control_channel, joint, recording, simulate

COMPLIANCE = 2e-3  # rad/(N m)
ROTOR = PENDULUM.replace('damping="0.05"', 'damping="0.05" armature="0.05"')
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
    return recording(
        [t] * 10, {"q": (joint("swing"), readings), "u": (control_channel(actuator="drive"), commands)}
    )


def test_a_soft_base_is_named_and_measured(taken):
    rig = bind(MjSpec.from_string(PENDULUM), taken.channels)
    verdict = diagnose(taken, rig).verdict
    assert [effect.name for effect in verdict.effects] == ["base_compliance"]
    across, compliance, _ = verdict.effects[0].parameters
    assert across.state == "flat"  # the rod does not tilt about its own length
    # The interval is of 90 %: half as wide again holds it but once in a hundred.
    half = (compliance.high - compliance.low) / 2
    assert abs(compliance.value - COMPLIANCE) < 1.57 * half < 0.2 * COMPLIANCE
    assert not verdict.unknown.flagged


def test_on_which_side_of_its_play_a_gear_is_told_by_the_data_before_a_window(monkeypatch):
    """A rod whose motor has play, its values given: errors of a held-out window are those of the readings."""
    rng, t, white = np.random.default_rng(4), np.arange(0, 2, 0.01), 1e-3
    u = [rng.uniform(0.5, 1.0) * np.sin(rng.uniform(5, 9) * t + rng.uniform(0, 6)) for _ in range(4)]
    blank = {"q": (joint("swing"), [np.sin(5 * t)] * 4), "u": (control_channel(actuator="drive"), u)}
    nominal = recording([t] * 4, blank)
    rig = bind(MjSpec.from_string(ROTOR), nominal.channels)
    problem = Problem.of(rig, nominal.channels, segment_recording(nominal, rig))
    effect = next(e for e in problem.catalogue if e.key == "backlash@swing (read at the link)")
    values = np.array([0.05, 0.05])
    moved = problem.restructured(effect, problem.trajectory)
    hypothesis = Hypothesis(moved.rig, (effect.on(moved.rig_motion),))
    model = hypothesis.compiled(values, 1e-3)
    readings = []
    for part in u:
        q, *_ = simulate(model, t, part[:, None], [rng.uniform(-1, 1), 0.0], [0.0, 0.0])
        readings.append(q.sum(axis=1) + white * rng.normal(size=len(t)))
    taken = recording([t] * 4, blank | {"q": (joint("swing"), readings)})
    windows = segment_recording(taken, rig, segment_s=1.0)
    noise = replace(moved.initial_noise, white=np.array([white]), coloured=np.zeros(1), force=1e-6)

    def errors() -> float:
        trajectory = held_out.initial_trajectory(moved, problem, windows)
        return held_out.predict(moved, hypothesis, values, windows, noise, trajectory).rms(np.array([0]))

    found = errors()
    monkeypatch.setattr(held_out, "_has_hidden_state", lambda hypothesis: False)
    assert found < 2 * white
    assert errors() > 2 * found
