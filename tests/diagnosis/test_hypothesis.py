"""Simulation of many states at once against MuJoCo's plain step, and torques of actuators by their laws."""

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator, actuator_torque
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.effects.joints.command_delay import CommandDelay
from slapshot.effects.joints.effect import JointEffect, Parameter, State
from slapshot.effects.joints.joint_offset import JointOffset
from slapshot.effects.joints.link_mass import LinkMass
from slapshot.effects.joints.spring import Spring
from slapshot.effects.joints.viscous_friction import ViscousFriction

from .mechanisms import ARM, PENDULUM, control_channel, joint, recording, simulate

# One of each law that is affine, on two joints that carry each other.
ACTUATED = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body><joint name="a" axis="0 1 0" damping="0.1"/><geom size="0.1" pos="0 0 -0.3"/>
      <body pos="0 0 -0.6"><joint name="b" axis="0 1 0" damping="0.1" actuatorfrcrange="-3 2"/>
        <geom size="0.1" pos="0.1 0 -0.3"/>
        <body pos="0 0 -0.6"><joint name="c" type="slide" axis="0 0 1"/><geom size="0.05"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="a" gear="3" ctrllimited="true" ctrlrange="-0.5 0.5"/>
    <position joint="a" kp="20" kv="1" forcelimited="true" forcerange="-4 4"/>
    <velocity joint="b" kv="2" gear="-2"/>
    <general joint="b" dyntype="filter" dynprm="0.05" gainprm="7"/>
    <general joint="c" gaintype="affine" gainprm="1 0.5 0.2" biastype="affine" biasprm="0.3 -2 -0.4"/>
    <intvelocity joint="c" kp="15" actrange="-1 1"/>
    <damper joint="a" kv="3" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
ANGLES = {"a": joint("a"), "b": joint("b")}


def states(model: mujoco.MjModel, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, model.nq + model.nv + model.na))
    return x, rng.normal(size=(count, 3, model.nu))


def test_torques_of_actuators_are_mujocos():
    rig = bind(MjSpec.from_string(ACTUATED), ANGLES)
    x, u = states(rig.model, 200, 1)
    found = actuator_torque(rig.model, x, u[:, 0], rig.load)
    limited = np.zeros(3, bool)
    data = mujoco.MjData(rig.model)
    for state, now, torque in zip(x, u[:, 0], found, strict=True):
        data.qpos[:], data.qvel[:], data.act[:] = state[:3], state[3:6], state[6:]
        data.ctrl[:] = now
        mujoco.mj_forward(rig.model, data)
        np.testing.assert_allclose(torque, data.qfrc_actuator, atol=1e-12)
        limited |= np.isin(data.qfrc_actuator, [-3, 2])
    assert limited[1]  # the joint's own limit was met


def test_actuators_by_other_laws_or_elsewhere_give_no_torque():
    text = PENDULUM.replace(
        '<motor name="drive" joint="swing"/>',
        '<motor site="tip" gear="0 0 0 0 1 0"/><muscle joint="swing" force="5" lengthrange="0 1"/>',
    )
    rig = bind(MjSpec.from_string(text), {"a": joint("swing")})
    x, u = np.array([[0.1, 0.2, 0.5]]), np.array([[1.0, 1.0]])
    assert actuator_torque(rig.model, x, u, rig.load).tolist() == [[0.0]]


@pytest.mark.parametrize("text", [ACTUATED, ARM, PENDULUM])
def test_an_interval_is_so_many_steps_of_mujoco(text):
    rig = bind(MjSpec.from_string(text), {"a": joint(MjSpec.from_string(text).joints[0].name)})
    model = rig.model
    x, u = states(model, 20, 2)
    force = np.random.default_rng(3).normal(size=(20, model.nv))
    moved, y, torque = Simulator(rig, threads=2).run(model, x, u, force)
    for i in range(20):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = x[i, : model.nq], x[i, model.nq : model.nq + model.nv]
        data.act[:], data.qfrc_applied[:] = x[i, model.nq + model.nv :], force[i]
        for step in range(3):
            data.ctrl[:] = u[i, step]
            mujoco.mj_step(model, data)
            if step == 0:
                np.testing.assert_allclose(torque[i], data.qfrc_actuator, atol=1e-12)
        np.testing.assert_allclose(moved[i], np.concatenate([data.qpos, data.qvel, data.act]), atol=1e-11)
    np.testing.assert_allclose(y[:, 0], x[:, 0], atol=1e-14)


def swinging() -> tuple[Rig, object, object]:
    """The pendulum driven for 1 s at 100 Hz; rig, segments, situation."""
    t = np.arange(101) * 0.01
    u = np.sin(9 * t)[:, None]
    qpos, qvel, _, _ = simulate(PENDULUM, t, u, [0.3], [0.0])
    made = recording(
        t, {"angle": (joint("swing"), qpos[:, 0]), "drive": (control_channel(actuator="drive"), u[:, 0])}
    )
    rig = bind(MjSpec.from_string(PENDULUM), made.channels)
    segments = segment_recording(made, rig)
    trajectory = np.concatenate([qpos, qvel], axis=1)[:100].reshape(*segments.shape, 2)
    return rig, segments, rig_motion(rig, segments, trajectory)


def test_force_laws_act_anew_in_every_step():
    rig, _, of = swinging()
    (spring,) = Spring.instances(of)
    simulator, hypothesis, theta = Simulator(rig), Hypothesis(rig, (spring,)), np.array([3.0, 0.4])
    model = hypothesis.compiled(theta, 0.002)
    x, u = np.array([[0.5, -1.0], [0.1, 2.0]]), np.array([[[0.1], [0.2], [0.3], [0.4]]] * 2)
    extra = np.array([[0.7], [-0.3]])
    moved, y, torque = simulator.advance(hypothesis, theta, model, x, u, np.zeros(2), np.zeros(2), extra)
    for i in range(2):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = x[i]
        for step in range(4):
            pull = 0.4 - 3.0 * (data.qpos[0] - of.joints[0].middle)
            data.ctrl[0], data.qfrc_applied[0] = u[i, step, 0], pull + extra[i, 0]
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(moved[i], [data.qpos[0], data.qvel[0]], atol=1e-13)
    np.testing.assert_allclose(y[:, 0], x[:, 0])
    np.testing.assert_allclose(torque[:, 0], 0.1)


class Clocked(JointEffect):
    """A force that tells when it acted."""

    name, physics, source, phrase = "clocked", "", "", ""

    def force(self, state: State, values: np.ndarray) -> np.ndarray:
        return values[0] * state.time[:, None] + values[1] * state.order[:, None]


def test_force_laws_know_the_time_and_the_place_in_the_session():
    rig, *_ = swinging()
    simulator = Simulator(rig)
    hypothesis = Hypothesis(rig, (Clocked("", [Parameter("a", "1", 1.0), Parameter("b", "1", 1.0)]),))
    model = hypothesis.compiled(np.zeros(2), 0.002)
    x, u = np.zeros((1, 2)), np.zeros((1, 5, 1))
    theta, time, order = np.array([2.0, 3.0]), np.array([7.0]), np.array([0.5])
    moved, *_ = simulator.advance(hypothesis, theta, model, x, u, time, order)
    data = mujoco.MjData(model)
    for step in range(5):
        data.qfrc_applied[0] = 2 * (7 + 0.002 * step) + 3 * 0.5
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(moved[0], [data.qpos[0], data.qvel[0]], atol=1e-14)


def test_values_stand_in_the_order_of_effects():
    rig, segments, of = swinging()
    (friction,), (spring,), (mass,) = (tuple(k.instances(of)) for k in (ViscousFriction, Spring, LinkMass))
    (delay,), offset = CommandDelay.instances(of), next(JointOffset.instances(of))
    hypothesis = Hypothesis(rig, (friction, spring)).with_effect(mass).with_effect(delay).with_effect(offset)
    assert [(s.start, s.stop) for s in hypothesis.slices] == [(0, 1), (1, 3), (3, 4), (4, 5), (5, 6)]
    theta = np.array([0.2, 1.0, 0.5, 0.1, 0.02, 0.03])
    model = hypothesis.compiled(theta, 0.004)
    assert model.opt.timestep == 0.004
    assert model.dof_damping[0] == pytest.approx(0.05 + 0.2)
    assert model.body_mass[1] == pytest.approx(1.1)
    assert model.body_subtreemass[1] == pytest.approx(1.1)  # what follows from it is made anew
    # The nominal model is as it was.
    assert rig.model.dof_damping[0] == 0.05
    assert rig.model.body_mass[1] == 1.0
    assert rig.model.opt.timestep == 0.01
    # A delay of two steps.
    told_of, acting = segments.control(), hypothesis.control(segments, theta)
    flat, late = told_of.reshape(-1), acting.reshape(-1)
    np.testing.assert_allclose(late[2:], flat[:-2], atol=1e-12)


def test_values_stay_within_what_is_possible():
    rig, _, of = swinging()
    (friction,), (delay,) = ViscousFriction.instances(of), CommandDelay.instances(of)
    hypothesis = Hypothesis(rig, (friction, delay))
    np.testing.assert_allclose(hypothesis.clipped(np.array([-1.0, -0.1])), [-0.05, 0.0])
    np.testing.assert_allclose(hypothesis.clipped(np.array([7.0, 2.0])), [7.0, 1.0])
    assert Hypothesis(rig).clipped(np.zeros(0)).shape == (0,)


PHANTOM = 'contype="0" conaffinity="0"'


@pytest.mark.parametrize(
    ("geoms", "pair", "collides"),
    [
        ("", "", True),
        ('contype="0" conaffinity="0"', "", False),
        ('contype="0" conaffinity="0"', "yes", True),
    ],
)
def test_contacts_are_left_out_only_where_no_geoms_can_touch(geoms, pair, collides):
    text = f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" {geoms}/>
    <body pos="0 0 0.5"><joint name="fall" type="slide" axis="0 0 1"/><geom name="ball" size="0.1" {geoms}/>
    </body></worldbody>{'<contact><pair geom1="floor" geom2="ball"/></contact>' if pair else ""}</mujoco>"""
    t = np.arange(100) * 0.01
    made = recording(t, {"z": (joint("fall", unit="m"), 0 * t)})
    rig = bind(MjSpec.from_string(text), made.channels)
    assert rig.collides == collides
    model, data = mujoco.MjModel.from_xml_string(text), mujoco.MjData(mujoco.MjModel.from_xml_string(text))
    for _ in range(500):
        mujoco.mj_step(model, data)
    compiled = Hypothesis(rig).compiled(np.zeros(0), model.opt.timestep)
    end, *_ = Simulator(rig).run(compiled, np.zeros((1, 2)), np.zeros((1, 500, 0)))
    # It rests on the floor, or has fallen for a second.
    assert (end[0, 0] > -0.45) == collides
    np.testing.assert_allclose(end[0], [data.qpos[0], data.qvel[0]], atol=1e-9)
