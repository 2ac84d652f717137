"""The first trajectory against motions in closed form, and the scales that are read from it."""

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis.fit.linear import linearise
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.rig_motion import rig_motion, torque_scale
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.recordings.channels import QUATERNION, Channel

from .mechanisms import ARM, BRICK, CART, HANGER, PENDULUM, control_channel, joint, place, recording, simulate

INERTIA = 1 / 12 + 0.25


def cut_up(
    text: str, t: np.ndarray, data: dict[str, tuple[Channel, np.ndarray]], segment_s: float = 0.5
) -> tuple[Rig, Segments]:
    made = recording(t, data)
    rig = bind(MjSpec.from_string(text), made.channels)
    return rig, segment_recording(made, rig, segment_s=segment_s)


def test_joints_follow_what_was_recorded():
    rng = np.random.default_rng(1)
    t = np.arange(300) * 0.01
    angle = np.sin(3 * t)
    data = {"e": (joint("elbow"), angle + 1e-4 * rng.standard_normal(300))}
    rig, segments = cut_up(ARM, t, data)
    x = recorded_trajectory(rig, segments)
    nodes = segments.time[segments.inside]
    there = x[segments.inside]
    np.testing.assert_allclose(there[:, 1], np.sin(3 * nodes), atol=5e-4)
    # Slopes of cubics over 7 samples: 1e-4 / 10 ms · 0.4, and five times that at the ends of the episode,
    # where the window is one-sided.
    np.testing.assert_allclose(there[:, 3], 3 * np.cos(3 * nodes), atol=0.05)
    np.testing.assert_allclose(there[10:-10, 3], 3 * np.cos(3 * nodes)[10:-10], atol=0.02)
    # What nobody observed rests where the model begins.
    assert np.all(x[..., [0, 2]] == 0)


def test_what_nobody_observed_rests_at_the_keyframe():
    home = '<keyframe><key name="home" qpos="0.3 -0.2"/></keyframe></mujoco>'
    t = np.arange(100) * 0.01
    rig, segments = cut_up(ARM.replace("</mujoco>", home), t, {"e": (joint("elbow"), np.sin(3 * t))})
    x = recorded_trajectory(rig, segments)
    assert np.all(x[..., 0] == 0.3)
    assert np.all(x[..., 2] == 0)
    np.testing.assert_allclose(
        x[segments.inside][:, 1], np.sin(3 * segments.time[segments.inside]), atol=5e-4
    )


@pytest.mark.parametrize("kind", ["filter", "filterexact"])
def test_a_filter_follows_its_control(kind):
    """As MuJoCo simulates it, which begins where the control does."""
    motor = f'<general name="servo" joint="shoulder" dyntype="{kind}" dynprm="0.05"/>'
    text = ARM.replace('<position name="servo" joint="shoulder" kp="30" kv="2"/>', motor)
    t = np.arange(300) * 0.004
    u = np.where(t < 0.4, 0.5, -1.0)
    data = {"e": (joint("elbow"), 0 * t), "servo": (control_channel(actuator="servo"), u)}
    rig, segments = cut_up(text, t, data)
    x = recorded_trajectory(rig, segments)[segments.inside]
    expected = np.where(t < 0.4, 0.5, -1.0 + 1.5 * np.exp(-(t - 0.4) / 0.05))
    np.testing.assert_allclose(x[:, -1], expected, atol=1e-6)
    scales = rig_motion(rig, segments, recorded_trajectory(rig, segments))
    assert scales.joints[0].largest == pytest.approx((1.0,), rel=1e-3)


def test_gaps_and_jitter_are_bridged():
    rng = np.random.default_rng(2)
    t = np.arange(300) * 0.01
    t[1:-1] += rng.uniform(-0.003, 0.003, 298)
    keep = np.ones(300, bool)
    keep[100:108] = False
    rig, segments = cut_up(PENDULUM, t[keep], {"a": (joint("swing"), 2 * t[keep])})
    x = recorded_trajectory(rig, segments)
    there = segments.inside
    # Straight lines come back as they were, wherever the samples lie.
    np.testing.assert_allclose(x[there][:, 0], 2 * segments.time[there], atol=0.02)
    np.testing.assert_allclose(x[there][20:-20, 0], 2 * segments.time[there][20:-20], atol=1e-9)
    np.testing.assert_allclose(x[there][20:-20, 1], 2, atol=1e-8)


def turned(t: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(n, 4) quaternions of a rotation that goes on at a constant angular velocity in the turned frame."""
    q, out = np.array([0.5, 0.5, -0.5, 0.5]), []
    for moment in t:
        now = q.copy()
        mujoco.mju_quatIntegrate(now, velocity, moment)
        out.append(now)
    return np.array(out)


@pytest.mark.parametrize("text", [BRICK, HANGER])
def test_rotations_follow_what_was_recorded(text):
    """Through several turns, whatever sign each sample of the quaternion has."""
    rng = np.random.default_rng(3)
    t, velocity = np.arange(200) * 0.01, np.array([6.0, -2.0, 9.0])
    q = turned(t, velocity) * rng.choice([-1.0, 1.0], (200, 1))
    channels = {c: place("body", "brick", c) for c in QUATERNION}
    if text is HANGER:
        channels = {c: joint("hook", unit="1", component=c) for c in QUATERNION}
    rig, segments = cut_up(text, t, {c: (channels[c], q[:, i]) for i, c in enumerate(QUATERNION)})
    assert rig.quaternions == ([0, 1, 2, 3],)
    x = recorded_trajectory(rig, segments)[segments.inside]
    model = rig.model
    at = 3 if text is BRICK else 0
    there = x[:, at : at + 4]
    # Half the angular velocity over 30 ms, to the fourth order: a share of 0.005 at most.
    assert np.all(np.abs(np.sum(there * turned(t, velocity)[: len(there)], axis=1)) > 1 - 1e-4)
    np.testing.assert_allclose(
        x[5:-5, model.nq + at : model.nq + at + 3], np.tile(velocity, (len(x) - 10, 1)), atol=0.1
    )
    # Neither sign of a quaternion is a residual.
    simulator, hypothesis = Simulator(rig), Hypothesis(rig)
    trajectory = recorded_trajectory(rig, segments)
    r = linearise(simulator, hypothesis, np.zeros(0), segments, trajectory).system.r
    assert np.abs(r[segments.inside]).max() < 1e-2


def test_a_quaternion_that_is_observed_in_part_is_none():
    t = np.arange(20) * 0.01
    rig, segments = cut_up(BRICK, t, {c: (place("body", "brick", c), np.ones(20)) for c in "xyz"})
    assert rig.quaternions == ()
    x = recorded_trajectory(rig, segments)
    np.testing.assert_allclose(x[segments.inside][:, :3], 1)
    assert np.all(x[..., 3:7] == [1, 0, 0, 0])


def test_a_flying_body_follows_its_place():
    t = np.arange(100) * 0.01
    place_ = np.stack([3 * t, 1 - t, 2 + 4 * t - 9.81 / 2 * t**2], axis=1)
    data = {c: (place("body", "brick", c), place_[:, i]) for i, c in enumerate("xyz")}
    rig, segments = cut_up(BRICK, t, data)
    x = recorded_trajectory(rig, segments)[segments.inside]
    # Parabolas are cubics: exact.
    np.testing.assert_allclose(x[:, :3], place_[: len(x)], atol=1e-9)
    velocity = np.stack([0 * t + 3, 0 * t - 1, 4 - 9.81 * t], axis=1)[: len(x)]
    np.testing.assert_allclose(x[:, 7:10], velocity, atol=1e-8)


def test_episodes_are_smoothed_apart():
    t = np.arange(50) * 0.01
    made = recording([t, t], {"a": (joint("swing"), [np.zeros(50), np.ones(50)])})
    rig = bind(MjSpec.from_string(PENDULUM), made.channels)
    segments = segment_recording(made, rig, segment_s=0.25)
    x = recorded_trajectory(rig, segments)
    np.testing.assert_allclose(x[:2, :, 0], 0, atol=1e-12)
    np.testing.assert_allclose(x[2:, :, 0], 1, atol=1e-12)
    np.testing.assert_allclose(x[..., 1], 0, atol=1e-10)


@pytest.mark.parametrize("samples", [2, 3, 4, 6])
def test_very_short_episodes(samples):
    t = np.arange(samples) * 0.01
    rig, segments = cut_up(PENDULUM, t, {"a": (joint("swing"), 0.5 + 3 * t)})
    x = recorded_trajectory(rig, segments)
    np.testing.assert_allclose(x[segments.inside][:, 0], 0.5 + 3 * t, atol=1e-12)
    np.testing.assert_allclose(x[segments.inside][:, 1], 3, atol=1e-9)


def test_scales_of_a_swinging_rod():
    """Inverse dynamics: torque = I a + m g l sin q, at the ends of an episode as in its middle."""
    t = np.arange(230) * 0.01  # ends in the middle of a segment, in full motion
    q, v, a = 0.8 * np.sin(4 * t), 3.2 * np.cos(4 * t), -12.8 * np.sin(4 * t)
    u = 0.7 * np.ones(230)
    rig, segments = cut_up(
        PENDULUM, t, {"a": (joint("swing"), q), "drive": (control_channel(actuator="drive"), u)}
    )
    assert not segments.inside.all()
    trajectory = recorded_trajectory(rig, segments)
    torque = np.sqrt(np.mean((INERTIA * a + 9.81 * 0.5 * np.sin(q)) ** 2))
    # 6 % for one-sided differences at the ends of segments.
    np.testing.assert_allclose(torque_scale(rig, segments, trajectory), [torque], rtol=0.06)
    of = rig_motion(rig, segments, trajectory)
    (swing,) = of.joints
    assert (swing.name, swing.q, swing.v, swing.unit, swing.actuators) == ("swing", 0, 0, "N m", (0,))
    assert swing.torque == pytest.approx(torque, rel=0.06)
    assert swing.speed == pytest.approx(np.sqrt(np.mean(v**2)), rel=0.01)
    assert swing.travel == pytest.approx(np.std(q), rel=0.01)
    assert swing.inertia == pytest.approx(INERTIA, rel=1e-6)
    assert np.max(swing.largest) == pytest.approx(0.7)
    assert (of.interval, of.episodes, of.speed) == (pytest.approx(0.01), 1, 0)


def test_what_hardly_moves_has_a_scale_all_the_same():
    t = np.arange(100) * 0.01
    data = {"s": (joint("shoulder"), np.sin(6 * t)), "e": (joint("elbow"), 0 * t)}
    rig, segments = cut_up(ARM, t, data)
    of = rig_motion(rig, segments, recorded_trajectory(rig, segments))
    shoulder, elbow = of.joints
    assert 0 < elbow.speed == pytest.approx(1e-3 * shoulder.speed, rel=1e-6)
    assert elbow.travel > 0


def test_scales_of_a_flying_body():
    t = np.arange(100) * 0.01
    data = {c: (place("body", "brick", c), (2.0, 1.0, 0.0)[i] * t) for i, c in enumerate("xyz")}
    rig, segments = cut_up(BRICK, t, data)
    trajectory = recorded_trajectory(rig, segments)
    of = rig_motion(rig, segments, trajectory)
    assert of.joints == ()
    assert of.free_bodies == ((1, 0),)
    assert of.speed == pytest.approx(np.sqrt(5))
    # To fly level it takes its weight.
    torque = torque_scale(rig, segments, trajectory)
    assert torque[2] == pytest.approx(0.4 * 9.81, rel=1e-6)
    assert np.all(torque[[0, 1, 3, 4, 5]] == pytest.approx(1e-3 * torque[2]))


def test_units_of_slides():
    t = np.arange(60) * 0.01
    place_, speed, _, _ = simulate(CART, t, np.ones((60, 1)), [0.0], [0.0])
    rig, segments = cut_up(CART, t, {"p": (joint("rail", unit="m"), place_[:, 0])})
    (rail,) = rig_motion(rig, segments, recorded_trajectory(rig, segments)).joints
    assert (rail.unit, rail.angle_unit) == ("N", "m")
    assert rail.torque == pytest.approx(1.0, rel=0.02)
    assert rail.inertia == pytest.approx(2.0)
    assert rail.speed == pytest.approx(np.sqrt(np.mean(speed[:50] ** 2)), rel=0.05)


def test_a_gap_where_segments_were_taken_out_is_no_motion():
    """Held-out blocks of a long episode are no part of the data: the trajectory does not jump across them."""
    t = np.arange(400) * 0.01
    rig, whole = cut_up(CART, t, {"p": (joint("rail", unit="m"), 0.3 * t)})
    part = whole.select(np.array([0, 1, 4, 5, 7]))
    assert [list(run) for run in part.runs()] == [[0, 1], [2, 3], [4]]
    x = recorded_trajectory(rig, part)[part.inside]
    np.testing.assert_allclose(x[:, rig.model.nq], 0.3, rtol=1e-9)
