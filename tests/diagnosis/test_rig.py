"""Binding of channels to a model: by names, with sensors and motors that are right; refusals of one line."""

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.model.hypothesis import Simulator
from slapshot.diagnosis.model.rig import bind, load_spec
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.errors import InputError
from slapshot.recordings.channels import QUATERNION, Channel

from .mechanisms import ARM, BRICK, HANGER, PENDULUM, control_channel, joint, place, recording

URDF = """<?xml version="1.0"?>
<!-- exported -- not by hand -->
<robot name="acrobot">
  <joint name="base_weld" type="fixed">
    <parent link="world"/><child link="base"/>
  </joint>
  <link name="base">
    <inertial>
      <mass value="1.08"/><inertia ixx="5e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="5e-3"/>
    </inertial>
    <visual name="look"><geometry><mesh filename="./meshes/base.obj"/></geometry></visual>
  </link>
  <link name="Link1">
    <inertial>
      <origin xyz="0 0 -0.2" rpy="0 0 0"/><mass value="0.64"/>
      <inertia ixx="0.027" ixy="0" ixz="0" iyy="0.027" iyz="0" izz="0.027"/>
    </inertial>
    <visual><geometry><mesh filename="./meshes/Link1.obj"/></geometry></visual>
    <collision><geometry><mesh filename="package://acrobot/Link1.stl"/></geometry></collision>
  </link>
  <joint name="Joint1" type="revolute">
    <origin xyz="0.0342 0 0"/><parent link="base"/><child link="Link1"/><axis xyz="1 0 0"/>
    <limit lower="-3.14" upper="3.14" effort="6" velocity="20"/><dynamics damping="0.02" friction="0.1"/>
  </joint>
  <link name="Weight">
    <inertial>
      <mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
    </inertial>
  </link>
  <joint name="Weight" type="fixed">
    <origin xyz="0 0 -0.4"/><parent link="Link1"/><child link="Weight"/><axis xyz="0 0 0"/>
  </joint>
  <transmission type="SimpleTransmission" name="drive"><joint name="Joint1"/></transmission>
</robot>
"""


def control(quantity: str, unit: str, **of: str) -> Channel:
    return Channel(clock="c", role="control", quantity=quantity, unit=unit, **of)


def observation(quantity: str, unit: str, **of: str) -> Channel:
    return Channel(clock="c", role="observation", quantity=quantity, unit=unit, **of)


def spec(text: str) -> MjSpec:
    return MjSpec.from_string(text)


def observed(rig, qpos, qvel, u=None) -> np.ndarray:
    """What one step of simulation returns as observations of its first state."""
    x = np.concatenate([qpos, qvel, np.zeros(rig.model.na)])[None]
    u = np.zeros((1, 1, rig.model.nu)) if u is None else np.reshape(u, (1, 1, -1))
    return Simulator(rig).run(rig.model, x, u)[1][0]


def forward(text: str, qpos, qvel, u=0.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The user's own model, without anything added, at a state."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, u
    mujoco.mj_forward(model, data)
    return model, data


def test_channels_find_their_parts():
    channels = {
        "angle": joint("elbow"),
        "rate": joint("shoulder", "velocity", "rad/s"),
        "servo": control_channel("rad", actuator="servo"),
        "hand_z": place("site", "hand", "z"),
        "effort": joint("shoulder", "torque", "N m"),
    }
    rig = bind(spec(ARM), channels, "arm", ("link_mass",))
    assert [(c.input, c.channel) for c in rig.controls] == [("servo", "servo")]
    told_of = [(o.channel, o.quantity, o.dof, o.part) for o in rig.observations]
    assert told_of == [
        ("angle", "position", 1, "elbow"),
        ("rate", "velocity", 0, "shoulder"),
        ("hand_z", "position", None, "hand"),
        ("effort", "torque", 0, "shoulder"),
    ]
    assert (rig.name, rig.free) == ("arm", ("link_mass",))
    qpos, qvel, u = [0.3, -0.8], [1.1, 0.4], [0.5]
    _, data = forward(ARM, qpos, qvel, u)
    # The servo: 30 N m/rad, 2 N m s/rad.
    expected = [-0.8, 1.1, data.site("hand").xpos[2], 30 * (0.5 - 0.3) - 2 * 1.1]
    np.testing.assert_allclose(observed(rig, qpos, qvel, u), expected, atol=1e-12)


def test_the_users_model_is_left_as_it_is():
    own = spec(ARM)
    channels = {"angle": joint("elbow"), "torque": control_channel(joint="elbow")}
    rig = bind(own, channels)
    assert [a.name for a in own.actuators] == ["servo"]
    assert not own.sensors
    # What is written later has the motor that the recording needs, and no sensors.
    assert [a.name for a in rig.spec.actuators] == ["servo", "slapshot:elbow"]
    assert not rig.spec.sensors


def test_a_torque_on_a_joint_without_actuator_gets_a_motor():
    rig = bind(spec(ARM), {"angle": joint("elbow"), "torque": control_channel(joint="elbow")})
    assert [(c.input, c.channel) for c in rig.controls] == [("servo", None), ("slapshot:elbow", "torque")]
    x, u = np.array([[0.1, 0.2, 0.3, 0.4]]), np.array([[[0.0, 0.7]]])
    _, _, torque = Simulator(rig).run(rig.model, x, u)
    np.testing.assert_allclose(torque, [[-30 * 0.1 - 2 * 0.3, 0.7]], atol=1e-12)
    model, data = forward(ARM, x[0, :2], x[0, 2:], [0.0])
    data.qfrc_applied[1] = 0.7
    mujoco.mj_step(model, data)
    moved, _, _ = Simulator(rig).run(rig.model, x, u)
    np.testing.assert_allclose(moved[0], np.concatenate([data.qpos, data.qvel]), atol=1e-12)


def test_a_recorded_torque_acts_whole_whatever_limits_the_models_own_motors_have():
    limits = '<default><motor ctrlrange="-.1 .1" forcerange="-.2 .2"/></default>'
    rig = bind(
        spec(ARM.replace("<worldbody>", limits + "<worldbody>", 1)),
        {"angle": joint("elbow"), "torque": control_channel(joint="elbow")},
    )
    _, _, torque = Simulator(rig).run(rig.model, np.zeros((1, 4)), np.array([[[0.0, 0.7]]]))
    np.testing.assert_allclose(torque, [[0.0, 0.7]], atol=1e-12)


def test_a_recorded_torque_acts_whole_whatever_effort_a_urdf_gives_the_joint():
    weak = """<robot name="axis"><link name="base"/><link name="rod"><inertial><mass value="1"/>
    <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort=".1" velocity="1"/></joint></robot>"""
    model = mujoco.MjModel.from_xml_string(weak)
    assert model.jnt_actfrclimited.all()
    rig = bind(spec(weak), {"angle": joint("hinge"), "torque": control_channel(joint="hinge")})
    moved, _, torque = Simulator(rig).run(rig.model, np.zeros((1, 2)), np.array([[[0.7]]]))
    np.testing.assert_allclose(torque, [[0.7]], atol=1e-12)
    # From rest, by 0.7 N m, in a time step.
    inertia = rig.model.dof_M0[0]
    np.testing.assert_allclose(moved[0, 1], 0.7 / inertia * rig.model.opt.timestep, rtol=1e-6)


def test_a_rig_can_be_bound_again():
    """As a rig is that an effect restructures: its motors are there already."""
    channels = {"angle": joint("elbow"), "torque": control_channel(joint="elbow")}
    again = bind(bind(spec(ARM), channels).spec, channels)
    assert [c.input for c in again.controls] == ["servo", "slapshot:elbow"]


def test_torques_on_ball_and_free_joints_act_about_the_axis_that_is_told():
    turned = [np.cos(0.4), 0, np.sin(0.4), 0]  # 0.8 rad about y
    torques = {f"t{axis}": control_channel(joint="hook", component=axis) for axis in "yz"}
    ball = bind(spec(HANGER), {"qw": place("body", "hanger", "x"), **torques})
    assert [c.channel for c in ball.controls] == ["ty", "tz"]
    model = mujoco.MjModel.from_xml_string(HANGER)
    data = mujoco.MjData(model)
    data.qpos[:] = turned
    mujoco.mj_forward(model, data)
    # xfrc_applied takes torques in the world frame, which is that of the joint's parent.
    data.xfrc_applied[1, 3:] = [0, 0.02, 0.03]
    mujoco.mj_step(model, data)
    x = np.concatenate([turned, np.zeros(3)])[None]
    moved, _, _ = Simulator(ball).run(ball.model, x, np.array([[[0.02, 0.03]]]))
    np.testing.assert_allclose(moved[0], np.concatenate([data.qpos, data.qvel]), atol=1e-10)

    fx = control("force", "N", joint="flight", component="x")
    free = bind(
        spec(BRICK),
        {"x": place("body", "brick", "x"), "fx": fx, "ty": control_channel(joint="flight", component="y")},
    )
    model = mujoco.MjModel.from_xml_string(BRICK)
    data = mujoco.MjData(model)
    data.qpos[3:] = turned
    data.xfrc_applied[1] = [0.5, 0, 0, 0, 0.01, 0]
    mujoco.mj_step(model, data)
    x = np.concatenate([np.zeros(3), turned, np.zeros(6)])[None]
    moved, _, _ = Simulator(free).run(free.model, x, np.array([[[0.5, 0.01]]]))
    np.testing.assert_allclose(moved[0], np.concatenate([data.qpos, data.qvel]), atol=1e-10)


def test_bodies_sites_and_free_joints_are_read_in_the_world_frame():
    rng = np.random.default_rng(2)
    turn = rng.normal(size=4)
    qpos = np.concatenate([rng.normal(size=3), turn / np.linalg.norm(turn)])
    qvel = rng.normal(size=6)
    channels = {f"p{c}": place("body", "brick", c) for c in "xyz"}
    channels |= {c: place("body", "brick", c) for c in ("qw", "qx", "qy", "qz")}
    channels |= {f"v{c}": place("body", "brick", c, "velocity") for c in "xyz"}
    channels |= {f"w{c}": observation("velocity", "rad/s", body="brick", component=c) for c in "xyz"}
    rig = bind(spec(BRICK), channels)
    _, data = forward(BRICK, qpos, qvel)
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(data.model, data, mujoco.mjtObj.mjOBJ_XBODY, 1, velocity, 0)
    y = observed(rig, qpos, qvel)
    np.testing.assert_allclose(y[:7], qpos, atol=1e-12)
    np.testing.assert_allclose(y[7:10], velocity[3:], atol=1e-12)
    np.testing.assert_allclose(y[10:], velocity[:3], atol=1e-12)
    # By hand: qvel has linear velocity in the world frame and angular velocity in the body's.
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, qpos[3:])
    np.testing.assert_allclose(y[7:10], qvel[:3], atol=1e-12)
    np.testing.assert_allclose(y[10:], rotation.reshape(3, 3) @ qvel[3:], atol=1e-12)
    of_joint = {n: c.model_copy(update={"body": None, "joint": "flight"}) for n, c in channels.items()}
    np.testing.assert_allclose(observed(bind(spec(BRICK), of_joint), qpos, qvel), y, atol=1e-12)


def test_a_site_has_its_own_place_and_velocity():
    channels = {c: place("site", "hand", c) for c in "xyz"}
    channels |= {f"v{c}": place("site", "hand", c, "velocity") for c in "xyz"}
    qpos, qvel = np.array([0.4, -0.9]), np.array([0.7, 1.3])
    y = observed(bind(spec(ARM), channels), qpos, qvel)
    _, data = forward(ARM, qpos, qvel)
    np.testing.assert_allclose(y[:3], data.site("hand").xpos, atol=1e-12)
    step = 1e-6
    _, later = forward(ARM, qpos + step * qvel, qvel)
    _, before = forward(ARM, qpos - step * qvel, qvel)
    rate = (later.site("hand").xpos - before.site("hand").xpos) / (2 * step)
    np.testing.assert_allclose(y[3:], rate, atol=1e-8)


def test_a_ball_joint_reads_its_own_coordinates():
    text = HANGER.replace('<body name="hanger">', '<body name="hanger" quat="0.6 0.8 0 0">')
    channels = {c: joint("hook", unit="1", component=c) for c in ("qw", "qx", "qy", "qz")}
    channels |= {f"w{c}": joint("hook", "velocity", "rad/s", component=c) for c in "xyz"}
    qpos, qvel = np.array([0.5, 0.5, -0.5, 0.5]), np.array([0.1, 0.2, 0.3])
    y = observed(bind(spec(text), channels), qpos, qvel)
    np.testing.assert_allclose(y, np.concatenate([qpos, qvel]), atol=1e-12)


def test_sensors_and_actuators_of_the_model_by_their_own_names():
    sensors = '<sensor><gyro name="imu" site="tip"/><jointpos name="a" joint="swing"/></sensor></mujoco>'
    channels = {
        "imu_y": observation("velocity", "rad/s", sensor="imu", component="y"),
        "motor": observation("torque", "N m", actuator="drive"),
        "a": observation("position", "rad"),
        "drive": control("command", "N m"),
    }
    rig = bind(spec(PENDULUM.replace("</mujoco>", sensors)), channels)
    assert rig.controls[0].channel == "drive"
    np.testing.assert_allclose(observed(rig, [0.3], [1.7], [0.25]), [1.7, 0.25, 0.3], atol=1e-12)


def test_a_joint_that_is_read_by_a_sensor_or_a_motor_is_read_as_well_as_by_its_name():
    """A motor behind a gear is at another angle than its joint; a gyroscope is at no joint."""
    sensors = """<sensor><jointpos name="a" joint="swing"/><gyro name="imu" site="tip"/></sensor>
        <actuator><motor name="geared" joint="swing" gear="2"/></actuator></mujoco>"""
    channels = {
        "a": observation("position", "rad"),
        "imu_y": observation("velocity", "rad/s", sensor="imu", component="y"),
        "turned": observation("position", "rad", actuator="drive"),
        "geared": observation("position", "rad", actuator="geared"),
    }
    rig = bind(spec(PENDULUM.replace("</mujoco>", sensors)), channels)
    told = {o.channel: (o.dof, o.part) for o in rig.observations}
    assert told == {
        "a": (0, "swing"), "imu_y": (None, "imu"), "turned": (0, "swing"), "geared": (None, "geared")
    }  # fmt: skip


def test_parts_without_names_get_one():
    text = """<mujoco><worldbody><body><joint axis="0 1 0"/><geom size="0.1" pos="0 0 1"/>
        <body pos="0 0 1"><joint name="b" axis="0 1 0"/><geom size="0.1"/></body></body></worldbody>
        <actuator><motor joint="b"/><motor joint="b" gear="2"/></actuator></mujoco>"""
    rig = bind(spec(text), {"angle": joint("b")})
    for kind, count in (("joint", 2), ("actuator", 2), ("body", 3)):
        names = [getattr(rig.model, kind)(i).name for i in range(count)]
        assert all(names)
        assert len(set(names)) == count
    assert (rig.load >= 0).all()


def test_a_urdf_is_read_without_its_meshes(tmp_path):
    file = tmp_path / "acrobot.urdf"
    file.write_text(URDF)
    model = load_spec(file).compile()
    assert [model.body(i).name for i in range(model.nbody)] == ["world", "base", "Link1", "Weight"]
    np.testing.assert_allclose(model.body_mass, [0, 1.08, 0.64, 0.1])
    assert [model.joint(j).name for j in range(model.njnt)] == ["Joint1"]
    assert (model.dof_damping[0], model.dof_frictionloss[0]) == (0.02, 0.1)
    assert model.ngeom == 0
    # The pendulum hangs at rest, and gravity turns it back: 0.64 kg at 0.2 m and 0.1 kg at 0.4 m.
    data = mujoco.MjData(model)
    data.qpos[0] = 0.5
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias[0] == pytest.approx(9.81 * (0.64 * 0.2 + 0.1 * 0.4) * np.sin(0.5), rel=1e-9)
    rig = bind(load_spec(file), {"angle": joint("Joint1"), "torque": control_channel(joint="Joint1")})
    assert rig.controls[0].input == "slapshot:Joint1"


def test_options_for_mujoco_in_a_urdf_stay(tmp_path):
    file = tmp_path / "acrobot.urdf"
    extra = '<mujoco><option timestep="0.003"/><compiler balanceinertia="false"/></mujoco>'
    file.write_text(URDF.replace('<link name="base">', extra + '<link name="base">', 1))
    assert load_spec(file).compile().opt.timestep == 0.003


def test_an_mjcf_file_is_read_with_what_it_includes(tmp_path):
    (tmp_path / "arm.xml").write_text(f"<!-- no <robot> -->{ARM}")
    (tmp_path / "all.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
    for name in ("arm.xml", "all.xml"):
        assert load_spec(tmp_path / name).compile().njnt == 2


@pytest.mark.parametrize(
    "text", ["", "<mujoco", "<robot name='x'><link", "<mujoco><worldbody><body/></mujoco>", "\x00"]
)
def test_files_that_are_no_model_are_refused(tmp_path, text):
    file = tmp_path / "model.xml"
    file.write_text(text)
    with pytest.raises(InputError) as refusal:
        load_spec(file)
    message = str(refusal.value)
    assert message.startswith(f"{file}: does not compile (")
    assert "\n" not in message


def test_a_missing_model_is_refused(tmp_path):
    for file in (tmp_path / "none.xml", tmp_path):
        with pytest.raises(InputError, match=r"model is missing; name an MJCF or URDF file$"):
            load_spec(file)


SENSED = PENDULUM.replace("</mujoco>", '<sensor><gyro name="imu" site="tip"/></sensor></mujoco>')
DELAYED = PENDULUM.replace('joint="swing"/>', 'joint="swing" nsample="3" delay="0.02"/>')
ANGLE = {"angle": joint("swing")}


# A cart on a rail that a mocap body drags along, as environments drag grippers.
DRAGGED = """
<mujoco>
  <option timestep="0.004" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body name="handle" mocap="true" pos="0.5 0 0"/>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="2"/>
      <joint name="yaw" axis="0 0 1"/>
      <inertial mass="2" pos="0 0 0" diaginertia="1 1 1"/>
    </body>
  </worldbody>
  <equality><weld body1="handle" body2="cart" relpose="0 0 0 1 0 0 0"/></equality>
  <keyframe><key name="home" qpos="0.4 0.1"/></keyframe>
</mujoco>
"""


def handle(component: str) -> Channel:
    unit = "1" if component.startswith("q") else "m"
    return control("position", unit, body="handle", component=component)


def test_a_mocap_body_is_an_input():
    channels = {"position": joint("rail", unit="m"), "z": handle("z"), "w": handle("qw"), "x": handle("x")}
    rig = bind(spec(DRAGGED), channels)
    assert [one.input for one in rig.controls] == [f"handle {c}" for c in ("x", "y", "z", *QUATERNION)]
    assert [one.channel for one in rig.controls] == ["x", None, "z", "w", None, None, None]
    unbound = bind(spec(DRAGGED), {"a": joint("rail", unit="m")})
    assert [one.rest for one in unbound.controls] == [0.5, 0, 0, 1, 0, 0, 0]

    rng = np.random.default_rng(1)
    u = np.concatenate([0.3 * rng.standard_normal((20, 3)), rng.standard_normal((20, 4))], axis=1)
    model = mujoco.MjModel.from_xml_string(DRAGGED)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (0.3, 0.2), (0.1, -0.1)
    start = np.concatenate([data.qpos, data.qvel])
    states = []
    for pose in u:
        data.mocap_pos[0], data.mocap_quat[0] = pose[:3], pose[3:]
        states.append(np.concatenate([data.qpos, data.qvel]))
        mujoco.mj_step(model, data)
    simulator = Simulator(rig)
    found, _ = simulator.trajectory(rig.model, start[None], u[None, :, None])
    np.testing.assert_allclose(found[0], states, rtol=1e-9, atol=1e-12)
    assert np.ptp(found[0, :, 0]) > 1e-3
    end, first, _ = simulator.run(rig.model, start[None], u[None])
    np.testing.assert_allclose(end[0], np.concatenate([data.qpos, data.qvel]), rtol=1e-9, atol=1e-12)
    assert first[0, 0] == 0.3


REFUSED = {
    "a control of a body that moves by itself": (
        DRAGGED,
        {"x": control("position", "m", body="cart", component="x"), "y": joint("rail", unit="m")},
        "only mocap bodies are controlled",
    ),
    "a control of a site": (
        PENDULUM,
        {"x": control("position", "m", site="tip", component="x"), "y": joint("swing")},
        "a site is no input",
    ),
    "a body that is not there": (
        DRAGGED,
        {"x": control("position", "m", body="grip", component="x"), "y": joint("rail", unit="m")},
        "the model has no body 'grip'",
    ),
    "no such joint": (ARM, {"a": joint("wrist")}, "the model has no joint 'wrist'; it has: shoulder, elbow"),
    "no such site": (ARM, {"a": place("site", "foot", "x")}, "no site 'foot'; it has: hand"),
    "no such body": (ARM, {"a": place("body", "foot", "x")}, "no body 'foot'; it has: world, upper, lower"),
    "no such sensor": (
        SENSED,
        {"a": observation("velocity", "rad/s", sensor="gyro")},
        "no sensor 'gyro'; it has: imu",
    ),
    "no sensor by the channel's name": (
        ARM,
        {"a": observation("position", "rad")},
        "no sensor 'a'; it has: none",
    ),
    "no such actuator": (
        ARM,
        ANGLE | {"u": control_channel("rad", actuator="motor")},
        "no actuator 'motor'; it has: servo",
    ),
    "no actuator by the channel's name": (ARM, ANGLE | {"u": control("command", "rad")}, "no actuator 'u'"),
    "no such driven joint": (ARM, ANGLE | {"u": control_channel(joint="wrist")}, "no joint 'wrist'"),
    "angles are no torques": (
        ARM,
        {"a": joint("elbow"), "u": control("position", "rad", joint="elbow")},
        "channel u: controls joint elbow with a position; name the actuator",
    ),
    "driven twice": (
        PENDULUM,
        ANGLE | {"u": control_channel(actuator="drive"), "drive": control("command", "N m")},
        "channels: u and drive both drive drive; keep one",
    ),
    "torque at a servo": (
        ARM,
        {"a": joint("elbow"), "u": control_channel(joint="shoulder")},
        "which servo drives by a law of its own",
    ),
    "torque into a servo": (
        ARM,
        {"a": joint("elbow"), "u": control("torque", "N m", actuator="servo")},
        "channel u: a torque at actuator servo, which has a law of its own; record its input as a command",
    ),
    "a model in which nothing moves": (
        '<mujoco><worldbody><body name="ball"><geom size=".1"/></body></worldbody></mujoco>',
        {c: place("body", "ball", c) for c in "xyz"},
        "model: nothing in it can move; give bodies joints, or a freejoint",
    ),
    "an angle of a slide": (
        DRAGGED,
        {"x": joint("rail", unit="rad")},
        "channel x: unit 'rad' cannot be of joint rail, a slide, whose units are m, m/s, N",
    ),
    "a force at a hinge": (
        ARM,
        {"a": joint("elbow"), "u": control("force", "N", joint="elbow")},
        "channel u: unit 'N' cannot be of joint elbow, a hinge, whose units are rad, rad/s, N m",
    ),
    "nothing observed": (PENDULUM, {"u": control_channel(actuator="drive")}, "channels: nothing is observed"),
    "one number of many": (
        SENSED,
        {"a": observation("velocity", "rad/s", sensor="imu")},
        "imu has 3 numbers",
    ),
    "beyond a sensor": (
        SENSED,
        {"a": observation("position", "1", sensor="imu", component="qz")},
        "imu has 3 numbers",
    ),
    "many numbers of one": (
        SENSED.replace("gyro", "clock").replace(' site="tip"/>', "/>"),
        {"a": observation("velocity", "rad/s", sensor="imu", component="x")},
        "imu has one number",
    ),
    "a component of a hinge": (
        PENDULUM,
        {"a": joint("swing", "velocity", "rad/s", component="x")},
        "remove component 'x'",
    ),
    "a command observed": (
        PENDULUM,
        {"a": observation("command", "N m", actuator="drive")},
        "is an input, not an observation; make it a control",
    ),
    "a force at a site": (
        PENDULUM,
        {"a": observation("force", "N", site="tip", component="x")},
        "a force at site tip needs a sensor",
    ),
    "a torque of a free joint": (
        BRICK,
        {"a": observation("torque", "N m", joint="flight", component="x")},
        "needs a sensor",
    ),
    "a free joint has many numbers": (BRICK, {"a": joint("flight")}, "say which component it is"),
    "a ball joint has no place": (
        HANGER,
        {"a": observation("position", "m", joint="hook", component="x")},
        "name the body",
    ),
    "torque of a ball without axis": (
        HANGER,
        {"a": place("body", "hanger", "x"), "u": control_channel(joint="hook")},
        "hook has several axes; say which",
    ),
    "delays inside the model": (DELAYED, ANGLE, "has delays or plugins"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_bound_is_refused_in_one_line(case):
    text, channels, message = REFUSED[case]
    with pytest.raises(InputError) as refusal:
        bind(spec(text), channels)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_torque_at_a_motor_is_the_force_that_it_makes_whatever_its_gain():
    """Before its gear, as MuJoCo's sensors of actuators read it; a command is the input itself."""
    text = PENDULUM.replace("<motor", '<general gainprm="0.25" gear="50"')
    t, torque = np.arange(50) * 0.01, np.linspace(-1, 1, 50)
    for quantity, gain in (("torque", 0.25), ("command", 1.0)):
        drive = control_channel(actuator="drive").model_copy(update={"quantity": quantity})
        made = recording(t, {"a": (joint("swing"), 0 * t), "u": (drive, torque)})
        u = segment_recording(made, bind(spec(text), made.channels)).control().reshape(-1)
        np.testing.assert_allclose(gain * u[: len(t) - 1], torque[:-1], rtol=1e-9, atol=1e-12)


def test_a_force_and_a_torque_along_one_axis_of_a_free_body_are_two_motors():
    along = {"joint": "flight", "component": "x", "clock": "t", "role": "control", "hold": "previous"}
    channels = {
        "fx": Channel(quantity="force", unit="N", **along),
        "tx": Channel(quantity="torque", unit="N m", **along),
        "x": place("body", "brick", "x"),
    }
    model = bind(spec(BRICK), channels).model
    assert model.actuator_gear[:, 0].tolist() == [1, 0]
    assert model.actuator_gear[:, 3].tolist() == [0, 1]
