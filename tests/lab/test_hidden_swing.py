"""Concealed physics of swing and contact against known answers."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from slapshot.lab.blade import compile_rig, striker_pairs
from slapshot.lab.hit import TIMESTEP, RigSimulator
from slapshot.lab.hit_types import HitNoise, HitSpec

NOTHING = HitNoise(np.zeros(2), 1.0, np.zeros(7), 1.0)


def launch_of(scene, rig, motion, **chance):
    bench = RigSimulator(scene, rig)
    return bench.launches([HitSpec(motion, "puck", replace(NOTHING, **chance))])[0]


def heading(launch):
    return np.arctan2(launch.state[4], launch.state[3])


@pytest.fixture(scope="module")
def motion(motions):
    """One that goes straight ahead, or nearly so."""
    return min(motions, key=lambda m: abs(m.position(np.array([0.6]))[0, 0]))


@pytest.fixture(scope="module")
def null(lab_scene, plain_rig, motion):
    return launch_of(lab_scene, plain_rig, motion)


def test_a_delayed_command_shifts_the_swing_in_time(lab_scene, conceal, motion, null):
    rig = conceal("command_delay", 0.02, jitter_share=0.1)
    late = launch_of(lab_scene, rig, motion)
    assert late.joints[:20] == pytest.approx(np.tile(null.joints[0], (20, 1)), abs=1e-9)
    assert late.joints[20 : len(null.joints)] == pytest.approx(null.joints[: len(null.joints) - 20], abs=1e-4)
    assert late.time == pytest.approx(null.time + 0.02, abs=2e-3)
    assert late.state[3:5] == pytest.approx(null.state[3:5], rel=0.01, abs=0.01)
    later = launch_of(lab_scene, rig, motion, quirk={"command_delay": 1.0})
    assert later.joints[22 : len(null.joints)] == pytest.approx(
        null.joints[: len(null.joints) - 22], abs=1e-4
    )


def test_a_filter_of_second_order_lags_behind_a_steady_motion_by_its_amplitude(conceal):
    rig = conceal("tracking_lag", 0.02, damping_ratio=0.8, joints=[1.0, 0.5, 1.5, 1.0, 1.0, 1.0, 1.0])
    (follow,) = rig.filters
    ramp = np.linspace(0.1, 2.1, 2001)[:, None] * np.ones(7)
    followed = follow(ramp, 1e-3)
    assert followed[0] == pytest.approx(ramp[0])
    lag = (ramp[-1] - followed[-1]) / 1.0
    assert lag == pytest.approx(0.02 * np.array([1.0, 0.5, 1.5, 1.0, 1.0, 1.0, 1.0]))
    # Damped by 0.8 it overshoots a step by exp(-pi z / sqrt(1 - z^2)) = 1.5 %.
    step = np.concatenate([np.zeros((1, 7)), np.ones((800, 7))])
    assert follow(step, 1e-3).max(0) == pytest.approx(np.full(7, 1.0152), abs=1e-3)


def test_a_lagging_arm_strikes_late(lab_scene, conceal, motion, null):
    rig = conceal("tracking_lag", 0.02, damping_ratio=1.0, joints=[1.0] * 7)
    late = launch_of(lab_scene, rig, motion)
    assert late.time - null.time == pytest.approx(0.02, abs=5e-3)
    assert rig.concealed[0].truth()["parameters"] == {"time": 0.02}


def test_every_servo_has_its_own_gain(lab_scene, conceal):
    shares = [-1.2, -0.8, -1.0, -1.0, -1.0, -1.0, -1.0]
    rig = conceal("servo_gain", 0.5, joints=shares, damping_share=0.9)
    believed, true = lab_scene.compile(), compile_rig(lab_scene, None, TIMESTEP, rig.edits)
    for i, share in enumerate(shares):
        factor = np.exp(0.5 * share)
        assert true.actuator_gainprm[i, 0] == pytest.approx(factor * believed.actuator_gainprm[i, 0])
        assert true.actuator_biasprm[i, 1] == pytest.approx(factor * believed.actuator_biasprm[i, 1])
        damping = np.exp(0.9 * 0.5 * share) * believed.actuator_biasprm[i, 2]
        assert true.actuator_biasprm[i, 2] == pytest.approx(damping)
    assert rig.concealed[0].truth()["parameters"] == pytest.approx({"log_gain": -0.5})


def test_springs_behind_the_motors_twist_by_their_compliance(lab_scene, conceal):
    shares = [1.0, 0.0, 0.5, 0.0, 0.0, 1.5, 0.0]
    rig = conceal("joint_elasticity", 2e-4, joints=shares)
    model = compile_rig(lab_scene, None, TIMESTEP, rig.edits)
    names = [model.joint(i).name for i in range(model.njnt) if model.joint(i).name.endswith("_spring")]
    assert names == ["q0_spring", "q2_spring", "q5_spring"]
    data = mujoco.MjData(model)
    for _ in range(4000):
        for name in names:
            data.joint(name).qfrc_applied[0] = 5.0
        mujoco.mj_step(model, data)
    twisted = [data.joint(name).qpos[0] for name in names]
    # Torques act on links, so that motors (8000 to 800 N m/rad, axes that are not all apart) hold still.
    assert twisted == pytest.approx([5 * 2e-4, 5 * 1e-4, 5 * 3e-4], rel=2e-2)


def test_play_ends_at_its_stops(lab_scene, conceal):
    rig = conceal("backlash", 0.01, joints=[1.0, 0.0, 0.0, 0.5, 0.0, 1.5, 0.0])
    model = compile_rig(lab_scene, None, TIMESTEP, rig.edits)
    data = mujoco.MjData(model)
    for name, gap in (("q0_play", 0.01), ("q3_play", 0.005), ("q5_play", 0.015)):
        for sign in (1, -1):
            mujoco.mj_resetData(model, data)
            for _ in range(4000):
                data.joint(name).qfrc_applied[0] = sign
                mujoco.mj_step(model, data)
            assert data.joint(name).qpos[0] == pytest.approx(sign * gap / 2, abs=2e-5)


def test_encoders_sit_on_the_motors(lab_scene, conceal, motion, null):
    # What is behind a spring or play moves otherwise; what the encoders read is still where it was sent.
    for name, amplitude in (("joint_elasticity", 1e-3), ("backlash", 0.01)):
        other = launch_of(lab_scene, conceal(name, amplitude), motion)
        before = round(0.55 / 1e-3)
        assert np.abs(other.joints[:before] - motion.position(1e-3 * np.arange(before))).max() < 0.02
        assert other.state[3:5] != pytest.approx(null.state[3:5], rel=1e-4)


def test_a_crooked_arm_reads_right_and_is_elsewhere(lab_scene, conceal, nominal):
    links, zeros = np.zeros((7, 3)), np.zeros(7)
    links[2], zeros[0] = (0.0, 0.6, 0.0), 1.5
    rig = conceal("crooked_arm", 0.01, links=links.tolist(), zeros_rad_m=zeros.tolist())
    models = [lab_scene.compile(), compile_rig(lab_scene, None, TIMESTEP, rig.edits)]
    places = []
    for model in models:
        data = mujoco.MjData(model)
        data.qpos[:7] = nominal.contact_poses[0]
        mujoco.mj_kinematics(model, data)
        places.append(data.site(lab_scene.info.striker_site).xpos.copy())
        carrier = data.xmat[model.body_parentid[model.joint("q2").bodyid[0]]].reshape(3, 3)
    # The zero of axis 0, which stands in the origin, turns all; the link moves what hangs on it.
    turn = 0.015
    turned = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    assert places[1] == pytest.approx(turned @ places[0] + carrier @ np.array([0.0, 0.006, 0.0]), abs=1e-6)


def test_a_crooked_arm_does_not_scrape_the_board(lab_scene, conceal, nominal):
    rig = conceal("crooked_arm", 0.05)
    for pose in nominal.contact_poses:
        heights = []
        for model in (lab_scene.compile(), compile_rig(lab_scene, None, TIMESTEP, rig.edits)):
            data = mujoco.MjData(model)
            data.qpos[:7] = pose
            mujoco.mj_kinematics(model, data)
            heights.append(data.site(lab_scene.info.striker_site).xpos[2])
        assert abs(heights[1] - heights[0]) < 0.008  # of 10 mm under the blade


def test_restitution_changes_the_damping_of_the_contact_alone(lab_scene, conceal, motion, null):
    rig = conceal("restitution", 0.4, sign=1.0, speed_power=0.2, stiffness_share=0.0)
    solref = np.array([0.01, 0.4])
    at = {speed: rig.bounce(solref, speed) for speed in (1.0, 1.5, 3.0)}
    assert at[1.5] == pytest.approx([0.01 / np.exp(0.4), 0.4 * np.exp(0.4)])
    # The frequency 1 / (T z) stays; harder hits are damped more.
    assert [np.prod(s) for s in at.values()] == pytest.approx([0.004] * 3)
    assert at[1.0][1] < at[1.5][1] < at[3.0][1]
    dull = launch_of(lab_scene, rig, motion)
    lively = launch_of(lab_scene, conceal("restitution", 0.4, sign=-1.0), motion)
    speeds = [np.hypot(*launch.state[3:5]) for launch in (dull, null, lively)]
    assert speeds[0] < 0.98 * speeds[1] < 0.96 * speeds[2]


def test_friction_of_the_blade_is_that_of_all_its_contacts(lab_scene, conceal):
    rig = conceal("blade_friction", 0.7, sign=1.0)
    model = compile_rig(lab_scene, None, TIMESTEP, rig.edits)
    (pair,) = striker_pairs(model, lab_scene)
    believed = lab_scene.compile().pair(lab_scene.info.striker_pair).friction
    assert model.pair_friction[pair, :2] == pytest.approx(np.exp(0.7) * believed[:2])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turned_blade_turns_the_launch(lab_scene, conceal, motion, null, sign):
    # By the angle, less what friction along the face holds back.
    rig = conceal("blade_yaw", 0.1, sign=sign, roll_share=0.2)
    turned = heading(launch_of(lab_scene, rig, motion)) - heading(null)
    angle = rig.concealed[0].truth()["parameters"]["angle"]
    assert abs(angle) == 0.1
    assert 0.5 < turned / angle < 1.15


def test_a_curved_blade_sends_off_the_side_what_is_hit_off_the_middle(lab_scene, conceal, motion, null):
    # At y along a face of curvature k the normal is turned by k y, but friction and a blade that moves on
    # hold back some of it.
    rig = conceal("curved_blade", 3.0, apex_m=0.0)
    turned = []
    for offset in (-0.02, 0.02):
        aside = np.array([0.0, offset])
        flat = launch_of(lab_scene, replace(rig, concealed=()), motion, start_error=aside)
        turned.append(heading(launch_of(lab_scene, rig, motion, start_error=aside)) - heading(flat))
    assert 0.5 < (turned[1] - turned[0]) / (3.0 * 0.04) < 1.2
    # With no curvature to speak of it is the box: the same contact by another algorithm.
    nearly = launch_of(lab_scene, conceal("curved_blade", 1e-3), motion)
    assert nearly.state[3:5] == pytest.approx(null.state[3:5], rel=0.02, abs=0.02)


def test_a_compliant_blade_is_the_one_that_settings_describe(conceal, lab_scene):
    rig = conceal("compliant_blade", 0.04, segments=3, damping_ratio=0.2, twist_ratio=4.0)
    assert rig.striker.stiffness == pytest.approx(25.0)
    assert rig.striker.twist_stiffness == pytest.approx(100.0)
    model = compile_rig(lab_scene, rig.striker, TIMESTEP, rig.edits)
    assert len(striker_pairs(model, lab_scene)) == 3


def test_an_off_centre_mass_is_so_in_the_contact_as_well(lab_scene, conceal, motion, null):
    rig = conceal("offcentre_mass", 0.008, towards_rad=np.pi / 2, slug_share=0.5, radius_m=0.0381)
    believed = lab_scene.compile().body("puck")
    model = compile_rig(lab_scene, None, TIMESTEP, rig.edits)
    assert model.body("puck").ipos == pytest.approx(np.add(believed.ipos, (0.0, 0.008, 0.0)))
    assert model.body("puck").mass == pytest.approx(believed.mass)
    factor = rig.ground.centres[0, 2]
    assert np.sort(model.body("puck").inertia) == pytest.approx(np.sort(factor * believed.inertia))
    # Struck through the middle, which is on the right of its centre of mass, it turns to the left.
    spins = [launch.state[5] for launch in (launch_of(lab_scene, rig, motion), null)]
    assert spins[0] > spins[1] + 1.0
