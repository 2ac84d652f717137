"""Rigs that an effect restructures: a joint split in two, a robot on a base that gives way."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.diagnosis.model.structure import reindexed_motion, restructured, transferred_trajectory
from slapshot.diagnosis.selection.free_forms import FreeForce, free_forms
from slapshot.diagnosis.selection.problem import Problem
from slapshot.effects.joints.backlash import Backlash
from slapshot.effects.joints.base_compliance import BaseCompliance
from slapshot.effects.joints.effect import JointEffect, RigMotion, State
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse
from slapshot.effects.joints.joint_elasticity import JointElasticity
from slapshot.effects.joints.parts import carriers, moving_bodies
from slapshot.effects.joints.split import base_joint, deflection
from slapshot.recordings.channels import QUATERNION, Channel
from slapshot.recordings.signals import SignalRecording

from .mechanisms import PENDULUM, control_channel, joint, place, recording, simulate

ROTOR, LINK, WEIGHT = 0.05, 1 / 12 + 0.25, 9.81 * 0.5  # kg m², kg m², N m at a right angle
ROD = PENDULUM.replace('damping="0.05"', f'armature="{ROTOR}"').replace('timestep="0.01"', 'timestep="0.001"')
FLOATING = ROD.replace("<option", '<option gravity="0 0 0"')
DIRECT = ROD.replace(f'armature="{ROTOR}"', "")
SPLIT = [(kind, variant) for kind in (JointElasticity, Backlash) for variant in (0, 1)]


class RigSimulator:
    """A driven rod, recorded for two episodes, and a rig that an effect restructured."""

    def __init__(self, kind: type[JointEffect], variant: int = 0, text: str = ROD) -> None:
        t = np.arange(100) * 0.01
        u = [np.sin(7 * t)[:, None], 1.5 * np.cos(5 * t)[:, None]]
        states = [simulate(text, t, part, [0.3], [0.0]) for part in u]
        taken = recording(
            [t, t],
            {
                "angle": (joint("swing"), [s[0][:, 0] for s in states]),
                "rate": (joint("swing", "velocity", "rad/s"), [s[1][:, 0] for s in states]),
                "drive": (control_channel(actuator="drive"), [part[:, 0] for part in u]),
            },
        )
        self.channels: dict[str, Channel] = taken.channels
        self.nominal: Rig = bind(MjSpec.from_string(text), taken.channels)
        self.segments: Segments = segment_recording(taken, self.nominal)
        self.trajectory = recorded_trajectory(self.nominal, self.segments)
        self.scales: RigMotion = rig_motion(self.nominal, self.segments, self.trajectory)
        self.effect = list(kind.instances(self.scales))[variant]
        self.rig = restructured(self.nominal, self.effect, self.channels)

    def model(self, *values: float) -> mujoco.MjModel:
        """The restructured model at values of the effect's parameters."""
        return Hypothesis(self.rig, (self.effect,)).compiled(np.array(values), 0.001)


def rest(model: mujoco.MjModel, torque: float) -> mujoco.MjData:
    """Where a model with much damping comes to rest under a torque of the motor."""
    data = mujoco.MjData(model)
    data.ctrl[:] = torque
    for _ in range(8000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-5
    return data


@pytest.mark.parametrize(("kind", "added"), [(JointElasticity, 1), (Backlash, 1), (BaseCompliance, 2)])
def test_masses_stay_as_they_are(kind: type[JointEffect], added: int):
    of = RigSimulator(kind)
    old, new = of.nominal.model, of.rig.model
    assert new.nv == old.nv + added
    np.testing.assert_array_equal(new.body("rod").mass, old.body("rod").mass)
    # A base is put below as XML, in which numbers have six digits.
    np.testing.assert_allclose(new.body("rod").inertia, old.body("rod").inertia, rtol=1e-6)
    assert new.joint("swing").armature == pytest.approx(ROTOR)
    if added == 1:
        assert new.body_mass.sum() == old.body_mass.sum()
        # Motor and link as one have the inertia that the joint had.
        data, full = mujoco.MjData(new), np.zeros((2, 2))
        mujoco.mj_forward(new, data)
        mujoco.mj_fullM(new, data, full)
        np.testing.assert_allclose(full, [[LINK + ROTOR, LINK], [LINK, LINK]], rtol=1e-6)
    assert of.rig.controls == of.nominal.controls
    assert [o.channel for o in of.rig.observations] == ["angle", "rate"]


@pytest.mark.parametrize(("kind", "added"), [(JointElasticity, 1), (Backlash, 1), (BaseCompliance, 2)])
def test_a_keyframe_is_the_same_pose_and_what_was_added_rests_there(kind: type[JointEffect], added: int):
    text = ROD.replace("</mujoco>", '<keyframe><key qpos="0.4" qvel="-0.3"/></keyframe></mujoco>')
    of = RigSimulator(kind, text=text)
    model = of.rig.spec.copy().compile()
    for values, sizes, expected in ((model.key_qpos, model.nq, 0.4), (model.key_qvel, model.nv, -0.3)):
        own = int(model.joint("swing").qposadr[0])
        assert values.shape == (1, sizes)
        assert values[0, own] == pytest.approx(expected)
        assert np.delete(values[0], own) == pytest.approx(np.zeros(added))


def by_runge_and_kutta(model: mujoco.MjModel) -> mujoco.MjModel:
    """The method by which restructured models are simulated."""
    model = copy.copy(model)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    return model


@pytest.mark.parametrize("variant", [0, 1])
def test_a_stiff_spring_moves_as_one_joint_does(variant: int):
    """Momentum: motor = nominal - LINK/(LINK + ROTOR) deflection, which is at most 2 load/stiffness."""
    of = RigSimulator(JointElasticity, variant, FLOATING)
    compliance = of.effect.parameters[0].low
    t = np.arange(100) * 0.01
    u = 1.5 * np.sin(6 * t)[:, None]
    one, *_ = simulate(by_runge_and_kutta(of.nominal.model), t, u, [0.2], [0.5])
    two, *_ = simulate(of.model(compliance, 0.0), t, u, [0.2, 0.0], [0.5, 0.0])
    bound = 2 * 1.5 * compliance
    assert bound < 1e-3 < np.ptp(one)
    assert np.abs(two[:, 1]).max() < bound
    np.testing.assert_allclose(two[:, 0], one[:, 0], atol=bound)
    np.testing.assert_allclose(two[:, 0] + LINK / (LINK + ROTOR) * two[:, 1], one[:, 0], atol=1e-6)


def test_on_a_stiff_base_a_robot_moves_as_on_the_world():
    """The motor's torque is all that tilts the plate; the rod's own angle in the world does not change."""
    of = RigSimulator(BaseCompliance, text=DIRECT)
    compliance = of.effect.parameters[0].low
    t = np.arange(100) * 0.01
    u = 1.5 * np.sin(6 * t)[:, None]
    one, *_ = simulate(by_runge_and_kutta(of.nominal.model), t, u, [0.2], [0.5])
    model = of.model(compliance, compliance, 0.0)
    x, y, swing = (int(model.joint(name).qposadr[0]) for name in (base_joint("x"), base_joint("y"), "swing"))
    first, rate = np.zeros(3), np.zeros(3)
    first[swing], rate[int(model.joint("swing").dofadr[0])] = 0.2, 0.5
    two, *_ = simulate(model, t, u, first, rate)
    bound = 2 * 1.5 * compliance
    assert bound < 1e-3
    np.testing.assert_allclose(two[:, x], 0, atol=1e-9)
    assert 0 < np.abs(two[:, y]).max() < bound
    np.testing.assert_allclose(two[:, swing], one[:, 0], atol=bound)
    np.testing.assert_allclose(two[:, swing] + two[:, y], one[:, 0], atol=1e-6)


def test_a_spring_bends_by_load_over_stiffness():
    of = RigSimulator(JointElasticity)
    compliance = of.effect.parameters[0].start
    damped = of.model(compliance, 20.0)
    damped.dof_damping[0] = 2.0
    data = rest(damped, 2.0)
    assert data.joint(deflection("swing")).qpos[0] == pytest.approx(-2.0 * compliance, rel=1e-3)
    assert np.sin(data.qpos.sum()) == pytest.approx(2.0 / WEIGHT, rel=1e-3)  # motor and deflection: the link
    np.testing.assert_allclose(of.effect.static_deflection(np.array([2.0])), [-2.0 * compliance])


def test_play_is_taken_up_by_the_load():
    of = RigSimulator(Backlash)
    gap = of.effect.parameters[0].start
    damped = of.model(gap, 1.0)
    damped.dof_damping[0] = 2.0
    found = [rest(damped, load).joint(deflection("swing")).qpos[0] for load in (2.0, -2.0)]
    # The stop gives way by (1 - d)/d of the free acceleration times its time constant squared, d = 0.9.
    soft = 2.0 * (1 / ROTOR + 1 / LINK) * 0.004**2 * (1 - 0.9) / 0.9
    assert soft < 0.02 * gap
    np.testing.assert_allclose(found, [-gap, gap], atol=2 * soft)
    np.testing.assert_allclose(of.effect.static_deflection(np.array([2.0, -2.0])), [-gap, gap], rtol=1e-6)


def test_a_base_tilts_by_load_over_stiffness():
    of = RigSimulator(BaseCompliance, text=DIRECT)
    compliance = of.effect.parameters[1].start
    damped = of.model(3 * compliance, compliance, 5.0)  # that about the axis of the rod counts
    damped.dof_damping[int(damped.joint("swing").dofadr[0])] = 2.0
    data = rest(damped, 2.0)
    tilt = data.joint(base_joint("y")).qpos[0]
    assert tilt == pytest.approx(-2.0 * compliance, rel=1e-3)
    assert np.sin(tilt + data.joint("swing").qpos[0]) == pytest.approx(2.0 / WEIGHT, rel=1e-3)


@pytest.mark.parametrize(("kind", "variant"), SPLIT)
def test_an_encoder_at_the_link_reads_motor_and_deflection(kind: type[JointEffect], variant: int):
    of = RigSimulator(kind, variant)
    assert of.effect.reads_link is bool(variant)
    x = np.array([[0.4, -0.003, 1.1, 0.2]])  # motor and deflection, then their velocities
    _, seen, _ = Simulator(of.rig).run(of.model(0.01, 0.1), x, np.zeros((1, 1, 1)))
    np.testing.assert_allclose(seen, [[0.397, 1.3]] if variant else [[0.4, 1.1]], atol=1e-12)


@pytest.mark.parametrize(("kind", "variant"), [*SPLIT, (BaseCompliance, 0)])
def test_a_moved_path_keeps_what_is_observed(kind: type[JointEffect], variant: int):
    of = RigSimulator(kind, variant)
    moved = transferred_trajectory(of.nominal, of.rig, of.effect, of.segments, of.trajectory)
    model = of.rig.model
    x = moved.reshape(-1, moved.shape[-1])
    _, seen, _ = Simulator(of.rig).run(model, x, np.zeros((len(x), 1, 1)))
    before = of.trajectory.reshape(-1, 2)
    np.testing.assert_allclose(seen, before, atol=1e-12)
    if kind is BaseCompliance:
        return
    # The link stands behind the motor by what it takes to move it, gravity included.
    own = model.joint(deflection("swing"))
    rate = np.gradient(of.trajectory[..., 1], of.segments.interval, axis=1)
    load = LINK * rate + WEIGHT * np.sin(of.trajectory[..., 0])
    expected = of.effect.static_deflection(load)
    np.testing.assert_allclose(moved[..., int(own.qposadr[0])], expected, atol=1e-6)


def test_scales_and_effects_are_brought_over():
    of = RigSimulator(BaseCompliance)
    moved = reindexed_motion(of.scales, of.rig)
    (before,), (after,) = of.scales.joints, moved.joints
    swing = of.rig.model.joint("swing")
    assert (after.q, after.v) == (swing.qposadr[0], swing.dofadr[0])
    assert replace(after, q=before.q, v=before.v) == before
    assert of.effect.on(of.scales).key == of.effect.key


def test_pushes_act_on_the_same_joint_of_a_restructured_rig():
    of = RigSimulator(BaseCompliance)
    (joint,) = of.scales.joints
    pulse = Pulse(episode=0, order=0.0, begin=0.1, end=0.2)
    moved = ExternalPulse(joint, [pulse]).on(reindexed_motion(of.scales, of.rig))
    nv = of.rig.model.nv
    assert nv > 1
    still = np.zeros((2, nv))
    state = State(np.zeros((2, of.rig.model.nq)), still, still, np.array([0.05, 0.15]), np.zeros(2))
    push = still.copy()
    push[1, of.rig.model.joint("swing").dofadr[0]] = 3.0
    np.testing.assert_array_equal(moved.force(state, np.array([3.0])), push)


# A turret of two driven hinges in one body, inside a frame, beside a weight that hangs on a ball joint.
TURRET = """
<mujoco>
  <option timestep="0.005" integrator="RK4"/>
  <worldbody>
    <frame pos="0 0 1">
      <body name="turret">
        <joint name="pan" axis="0 0 1"/>
        <frame euler="90 0 0"><joint name="elbow" axis="0 0 1"/></frame>
        <inertial mass="0.2" pos="0.05 0 0" diaginertia="0.001 0.001 0.001"/>
      </body>
    </frame>
    <body name="elbow" pos="1 0 1">
      <joint name="hook" type="ball"/>
      <inertial mass="3" pos="0 0 -0.4" diaginertia="0.02 0.02 0.02"/>
    </body>
  </worldbody>
  <actuator><motor name="a" joint="pan"/><motor name="elbow" joint="elbow" gear="50"/></actuator>
</mujoco>
"""


def turret() -> tuple[Problem, SignalRecording]:
    rng, t = np.random.default_rng(2), np.arange(200) * 0.01
    u = np.stack([0.02 * np.sin(3 * t), 0.0004 * np.sin(4 * t)], axis=1)
    q, *_ = simulate(TURRET, t, u, [0.1, 0.2, 0.966, 0.259, 0, 0], rng.normal(size=5))
    turn = [Channel(
        clock="encoder", role="observation", quantity="position", unit="1", joint="hook", component=c
    ) for c in QUATERNION]  # fmt: skip
    channels = {
        "pan": (joint("pan"), q[:, 0]), "elbow": (joint("elbow"), q[:, 1]),
        "body": (place("body", "elbow", "x"), np.ones(200)),
        "a": (control_channel(actuator="a"), u[:, 0]), "b": (control_channel(actuator="elbow"), u[:, 1]),
        **{f"hook_{c.component}": (c, q[:, 2 + k]) for k, c in enumerate(turn)},
    }  # fmt: skip
    taken = recording(t, channels)
    rig = bind(MjSpec.from_string(TURRET), taken.channels)
    return Problem.of(rig, taken.channels, segment_recording(taken, rig)), taken


def test_a_joint_is_split_where_it_is_the_last_of_its_body_and_as_it_is_turned():
    problem, _ = turret()
    elastic = list(JointElasticity.instances(problem.rig_motion))
    assert {effect.part for effect in elastic} == {"elbow"}
    model = problem.restructured(elastic[0], problem.trajectory).rig.model
    own, added = model.joint("elbow"), model.joint(deflection("elbow"))
    assert added.axis == pytest.approx(own.axis, abs=1e-12)
    assert own.axis == pytest.approx([0, -1, 0], abs=1e-9)


def test_an_encoder_at_the_link_reads_its_joint_and_nothing_else_of_that_name():
    problem, taken = turret()
    elastic = list(JointElasticity.instances(problem.rig_motion))
    (at_link,) = [effect for effect in elastic if effect.reads_link]
    reading = restructured(problem.rig, at_link, taken.channels).reading
    summed = {o.channel for o, row in zip(problem.rig.observations, reading, strict=True) if row.sum() == 2}
    assert summed == {"elbow"}


def test_process_forces_stay_what_they_are_beside_a_split_joint():
    problem, _ = turret()
    moved = problem.restructured(next(JointElasticity.instances(problem.rig_motion)), problem.trajectory)
    kept = np.setdiff1d(np.arange(moved.rig.model.nv), moved.rig.added_dofs)
    assert moved.torque[kept] == pytest.approx(problem.torque)
    assert problem.torque[-3:].max() > 100 * problem.torque.min()


def test_a_free_form_over_load_spans_what_acts_behind_the_gear():
    problem, _ = turret()
    (load,) = [e for e in free_forms(problem.rig_motion, problem.segments)
               if isinstance(e, FreeForce) and e.part == "elbow" and e.variable == "load"]  # fmt: skip
    assert load.high == pytest.approx(50 * 0.0004, rel=0.01)


def test_a_base_gives_way_under_robots_in_frames():
    problem, _ = turret()
    (base,) = BaseCompliance.instances(problem.rig_motion)
    model = problem.restructured(base, problem.trajectory).rig.model
    nominal, new = mujoco.MjData(problem.rig.model), mujoco.MjData(model)
    mujoco.mj_kinematics(problem.rig.model, nominal)
    mujoco.mj_kinematics(model, new)
    for name in ("turret", "elbow"):
        assert new.body(name).xpos == pytest.approx(nominal.body(name).xpos)
        assert model.body("slapshot:base").id in carriers(model, model.body(name).id)
    assert "slapshot:base" not in {model.body(b).name for b in moving_bodies(model)}
