"""Joints whose position nobody recorded: seen by places of a site, by their velocity alone, or by a loop."""

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.model.unseen_joints import Loops
from slapshot.recordings.channels import Channel

from .mechanisms import ARM, PENDULUM, control_channel, joint, place, recording, simulate

COULOMB = 0.15  # N m
PLACE_NOISE, SPEED_NOISE = 2e-4, 2e-3  # m, rad/s


def swings(seen: str, friction: float, episodes: int = 10):
    """Ten times three seconds of a driven pendulum, observed by its tip or its velocity."""
    rng = np.random.default_rng(3)
    model = mujoco.MjModel.from_xml_string(PENDULUM.replace("implicitfast", "RK4"))
    clocks, values, commands, angles = [], [], [], []
    for _ in range(episodes):
        t = np.arange(300) * 0.01
        u = 2.5 * np.sin(2 * np.pi * rng.uniform(0.3, 0.8) * t + rng.uniform(0, 6))[:, None]
        q, v, *_ = simulate(
            model, t, u, rng.normal(size=1), [0.0],
            law=lambda _, q, v: -friction * np.tanh(v / 0.01), finer=20,
        )  # fmt: skip
        clocks.append(t)
        commands.append(u[:, 0])
        angles.append(q[:, 0])
        if seen == "tip":
            tip = np.stack([-np.sin(q[:, 0]), -np.cos(q[:, 0])], axis=1)
            values.append(tip + PLACE_NOISE * rng.standard_normal(tip.shape))
        else:
            values.append(v + SPEED_NOISE * rng.standard_normal(v.shape))
    if seen == "tip":
        channels = {
            name: (place("site", "tip", name), [value[:, k] for value in values])
            for k, name in enumerate("xz")
        }
    else:
        channels = {"swing": (joint("swing", "velocity", "rad/s"), [value[:, 0] for value in values])}
    channels["drive"] = (control_channel(actuator="drive"), commands)
    return recording(clocks, channels), angles


def test_angles_are_found_from_places_of_a_site():
    made, angles = swings("tip", 0.0)
    rig = bind(MjSpec.from_string(PENDULUM), made.channels)
    segments = segment_recording(made, rig)
    trajectory = recorded_trajectory(rig, segments)
    error = [
        trajectory[s, segments.inside[s], 0]
        - np.interp(segments.time[s][segments.inside[s]], np.arange(300) * 0.01, angles[segments.episode[s]])
        for s in range(segments.shape[0])
    ]
    # The lever is 1 m. A cubic over 0.06 s leaves less than the noise of a place, but at ends of episodes.
    assert np.median(np.abs(np.concatenate(error))) < PLACE_NOISE
    assert np.abs(np.concatenate(error)).max() < 20 * PLACE_NOISE


def test_both_angles_of_an_arm_are_found_from_its_hand():
    model = mujoco.MjModel.from_xml_string(ARM)
    t = np.arange(200) * 0.01
    q = np.stack([0.3 + 0.4 * np.sin(3 * t), 0.9 + 0.5 * np.sin(5 * t)], axis=1)
    data, hand = mujoco.MjData(model), []
    for now in q:
        data.qpos[:] = now
        mujoco.mj_kinematics(model, data)
        hand.append(data.site("hand").xpos.copy())
    channels = {name: (place("site", "hand", name), np.array(hand)[:, "xyz".index(name)]) for name in "xz"}
    channels["servo"] = (control_channel("rad", actuator="servo"), q[:, 0])
    made = recording(t, channels)
    rig = bind(MjSpec.from_string(ARM), made.channels)
    segments = segment_recording(made, rig)
    found = recorded_trajectory(rig, segments)[segments.inside][:, :2]
    # Of both branches of the elbow one; the hand is where it was.
    for now, there in zip(found[10:-10:7], np.array(hand)[10:-10:7], strict=False):
        data.qpos[:] = now
        mujoco.mj_kinematics(model, data)
        assert data.site("hand").xpos == pytest.approx(there, abs=1e-3)


MARKERS = {"left": (0.04, 0.0, 0.01), "right": (-0.03, 0.02, 0.0), "top": (0.0, -0.01, 0.05)}  # m
TUMBLER = (
    """<mujoco><worldbody><body name="box" pos="0 0 1"><freejoint/><geom size=".1" mass="1"/>"""
    + "".join(
        f'<site name="{name}" pos="{" ".join(map(str, at))}"/>'
        for name, at in [*MARKERS.items(), ("middle", (0, 0, 0))]
    )
    + """<body name="cap"><site name="cap" quat="0 1 0 0"/></body></body></worldbody></mujoco>"""
)


def tumbling() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, and poses and velocities (n, 7 and 6) of a box that is thrown and turns at a constant rate."""
    t, turn = np.arange(120) * 0.005, np.array([3.0, -5.0, 4.0])
    pose, velocity = np.zeros((len(t), 7)), np.zeros((len(t), 6))
    pose[:, :3] = np.stack([2 * t, 1 - t, 1 + 3 * t - 9.81 / 2 * t**2], axis=1)
    velocity[:, :3] = np.stack([0 * t + 2, 0 * t - 1, 3 - 9.81 * t], axis=1)
    velocity[:, 3:] = turn
    for now, moment in zip(pose, t, strict=True):
        now[3:] = [0.8, 0.6, 0, 0]
        mujoco.mju_quatIntegrate(now[3:], turn, moment)
    return t, pose, velocity


def found_of_markers(names: list[str], kind: str = "site") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, true states and those that are found from places of sites."""
    model = mujoco.MjModel.from_xml_string(TUMBLER)
    t, pose, velocity = tumbling()
    data, places = mujoco.MjData(model), {name: np.empty((len(t), 3)) for name in names}
    for i, now in enumerate(pose):
        data.qpos[:] = now
        mujoco.mj_kinematics(model, data)
        for name, way in places.items():
            way[i] = (data.site(name) if kind == "site" else data.body(name)).xpos
    channels = {
        f"{name}_{c}": (place(kind, name, c), way[:, k])
        for name, way in places.items()
        for k, c in enumerate("xyz")
    }
    made = recording(t, channels)
    rig = bind(MjSpec.from_string(TUMBLER), made.channels)
    segments = segment_recording(made, rig)
    found = recorded_trajectory(rig, segments)[segments.inside]
    at = segments.time[segments.inside]
    rows = np.searchsorted(t, at - 1e-9)
    return at, np.hstack([pose, velocity])[rows], found


@pytest.mark.parametrize(("kind", "name"), [("site", "middle"), ("site", "cap"), ("body", "cap")])
def test_a_site_or_body_that_is_fixed_at_the_middle_of_a_flying_body_tells_its_flight(kind, name):
    _, true, found = found_of_markers([name], kind)
    # Parabolas are cubics: exact. Of one point the rotation is not known.
    np.testing.assert_allclose(found[:, :3], true[:, :3], atol=1e-9)
    np.testing.assert_allclose(found[:, 7:10], true[:, 7:10], atol=1e-6)
    np.testing.assert_allclose(found[:, 3:7], np.tile([1.0, 0, 0, 0], (len(found), 1)))


def test_a_marker_off_the_middle_tells_a_flight_but_for_its_lever():
    _, true, found = found_of_markers(["left"])
    lever = np.linalg.norm(MARKERS["left"])
    assert np.linalg.norm(found[:, :3] - true[:, :3], axis=1).max() < 2 * lever
    np.testing.assert_allclose(found[:, 3:7], np.tile([1.0, 0, 0, 0], (len(found), 1)))


@pytest.mark.parametrize("names", [[*MARKERS], [*MARKERS, "middle"]])
def test_markers_tell_the_pose_of_a_body_that_turns(names):
    _, true, found = found_of_markers(names)
    np.testing.assert_allclose(found[:, :3], true[:, :3], atol=1e-4)
    # A cubic of a circle errs by (.03 w)^4 / 24 in a window of 60 ms: by 3e-5 of a lever, or rad.
    alike = np.abs(np.sum(found[:, 3:7] * true[:, 3:7], axis=1))
    assert np.all(alike > np.cos(1e-3 / 2))
    np.testing.assert_allclose(found[5:-5, 10:], true[5:-5, 10:], atol=0.05)


GEARED = """<mujoco><worldbody>
<body><joint name="axis" axis="0 0 1"/><geom size=".1" mass="1"/></body>
</worldbody><actuator><motor name="motor" joint="axis" gear="50"/></actuator></mujoco>"""


def test_a_joint_is_seen_by_the_encoder_of_its_motor_behind_a_gear():
    t = np.arange(100) * 0.01
    angle = 0.3 * np.sin(4 * t) + 40 * t  # six turns
    channel = Channel(clock="encoder", role="observation", quantity="position", actuator="motor", unit="rad")
    made = recording(t, {"encoder": (channel, 50 * angle)})
    rig = bind(MjSpec.from_string(GEARED), made.channels)
    segments = segment_recording(made, rig)
    found = recorded_trajectory(rig, segments)[segments.inside]
    at = segments.time[segments.inside]
    # A cubic of a sine over 60 ms errs by .3 (4 * .03)^4 / 24.
    np.testing.assert_allclose(found[:, 0], 0.3 * np.sin(4 * at) + 40 * at, atol=1e-4)
    np.testing.assert_allclose(found[3:-3, 1], 1.2 * np.cos(4 * at)[3:-3] + 40, atol=0.01)


@pytest.mark.parametrize("seen", ["tip", "velocity"])
def test_friction_is_named_of_a_joint_whose_position_nobody_recorded(seen):
    made, _ = swings(seen, COULOMB)
    rig = bind(MjSpec.from_string(PENDULUM), made.channels)
    (effect,) = diagnose(made, rig).verdict.effects
    assert (effect.name, effect.part) == ("coulomb_friction", "swing")
    size = effect.parameters[0]
    assert size.value == pytest.approx(COULOMB, rel=0.03)


@pytest.mark.parametrize("seen", ["tip", "velocity"])
def test_nothing_is_found_where_nothing_is_missing(seen):
    made, _ = swings(seen, 0.0)
    rig = bind(MjSpec.from_string(PENDULUM), made.channels)
    assert diagnose(made, rig).verdict.headline == "nothing_found"


# Two equal rods, and a coupler that joins their ends: it keeps its direction, whatever the angle of the rods.
PARALLELOGRAM = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="first">
      <joint name="first" axis="0 1 0"/>
      <inertial mass="0.2" pos="0 0 0.05" diaginertia="2e-4 2e-4 1e-5"/>
      <body name="coupler" pos="0 0 0.1">
        <joint name="coupler" axis="0 1 0"/>
        <inertial mass="0.3" pos="0.15 0 0" diaginertia="1e-5 1e-3 1e-3"/>
        <site name="end" pos="0.3 0 0"/>
      </body>
    </body>
    <body name="second" pos="0.3 0 0">
      <joint name="second" axis="0 1 0"/>
      <inertial mass="0.2" pos="0 0 0.05" diaginertia="2e-4 2e-4 1e-5"/>
      <site name="top" pos="0 0 0.1"/>
    </body>
  </worldbody>
  <equality><connect site1="end" site2="top"/></equality>
  <actuator><motor name="drive" joint="first"/></actuator>
</mujoco>
"""


def test_joints_of_a_loop_follow_the_one_that_is_read():
    t = np.arange(200) * 0.01
    angle = 0.9 * np.sin(2 * t)
    made = recording(t, {"q": (joint("first"), angle), "u": (control_channel(actuator="drive"), 0 * t)})
    rig = bind(MjSpec.from_string(PARALLELOGRAM), made.channels)
    segments = segment_recording(made, rig)
    x, inside = recorded_trajectory(rig, segments), segments.inside
    wanted, rate = 0.9 * np.sin(2 * segments.time[inside]), 1.8 * np.cos(2 * segments.time[inside])
    # Steps of inverse kinematics end at 1e-5 rad; differences over 10 ms err by 3e-4 of the rate, and by
    # .01 of it where they are one-sided.
    for k, sign in enumerate((1, -1, 1)):
        np.testing.assert_allclose(x[inside][:, k], sign * wanted, atol=1e-4)
        np.testing.assert_allclose(x[inside][:, 3 + k], sign * rate, atol=0.04)


def test_a_weld_to_what_drags_a_gripper_is_no_loop():
    dragged = ARM.replace(
        "<worldbody>", '<worldbody><body name="hand-hold" mocap="true" pos="0.3 0.05 -0.6"/>'
    ).replace("<actuator>", '<equality><weld body1="hand-hold" body2="lower"/></equality><actuator>')
    assert Loops(MjSpec.from_string(PARALLELOGRAM).compile())
    assert not Loops(MjSpec.from_string(dragged).compile())
    assert Loops(MjSpec.from_string(dragged).compile()).violations(np.zeros((3, 4))).shape == (3, 0)
    assert not Loops(MjSpec.from_string(ARM).compile())
