import mujoco
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import torch
from slapshot.command import Run
from slapshot.domains.hockey.demonstrations import CONTACT_AT, blade_travel
from slapshot.errors import InputError
from slapshot.scenes.domain import load_domain
from slapshot.trajectories import demonstrations
from slapshot.trajectories.execution import TORQUE_SHARE, execute, striker_gap
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import MIN_CLEARANCE, SafetyCheck
from slapshot.trajectories.swings import SPLITS
from slapshot.trajectories.vae import TrajectoryVae
from told import scripted_hits


def test_blade_travel_is_at_unit_speed_and_zero_at_contact():
    # 33 waypoints, so that contact (3/4) is one of them. Central differences of a smooth curve err by
    # O(h^2), here below 1e-2.
    travel = blade_travel(33, 0.8)
    contact = round(CONTACT_AT * 32)
    assert travel[contact] == pytest.approx(0, abs=1e-6)
    speed = (travel[contact + 1] - travel[contact - 1]) / (2 * 0.8 / 32)
    assert speed == pytest.approx(1.0, abs=0.05)
    # The smooth step's mean is one half: the backswing is half the time times the speed.
    assert -travel[0] == pytest.approx(CONTACT_AT * 0.8 / 2, rel=1e-4)


@pytest.mark.parametrize("heading", [-np.pi / 2, -0.6, 0.0, 0.6, np.pi / 2])
@pytest.mark.parametrize("offset", [-0.06, 0.06])
def test_demonstration_brings_the_blade_where_and_as_fast_as_asked(scene, rig, heading, offset):
    settings = scripted_hits()
    task = {"heading": heading, "speed": 1.2, "contact_offset": offset}
    waypoints = load_domain("hockey").demonstrate(scene, settings, [task])[0]
    motion = Motion.through(waypoints, 0.8)
    assert SafetyCheck(scene).report(motion).safe
    import mujoco

    model = scene.compile()
    data = mujoco.MjData(model)
    places, step = [], 1e-3
    for time in (CONTACT_AT * 0.8 - step, CONTACT_AT * 0.8, CONTACT_AT * 0.8 + step):
        data.qpos[scene.layout.arm_q] = motion.position(np.array([time]))[0]
        mujoco.mj_kinematics(model, data)
        places.append(data.site_xpos[scene.layout.striker_site].copy())
    velocity = (places[2] - places[0]) / (2 * step)
    ahead = np.array([np.cos(heading), np.sin(heading), 0])
    aside = np.array([-ahead[1], ahead[0], 0])
    reach = scene.info.object_radius + scene.info.striker_half_thickness
    expected = np.array([*scene.info.start, 0]) - ahead * reach + aside * offset
    # Inverse kinematics stops at 1e-6; between waypoints the spline adds about a millimetre.
    assert places[1][:2] == pytest.approx(expected[:2], abs=2e-3)
    assert velocity @ ahead == pytest.approx(1.2, rel=0.03)
    assert abs(velocity @ aside) < 0.06


def test_every_demonstration_respects_every_limit(rig, scene):
    table = pq.read_table(rig.folders["demonstrations"] / "demonstrations.parquet").to_pandas()
    assert len(table) >= 1000
    limits = np.array(scene.info.speed_limits)
    times = np.linspace(0, 0.8, 400)
    for flat in table["waypoints"][::25]:
        motion = Motion.through(flat.reshape(17, 7), 0.8)
        assert (np.abs(motion.velocity(times)) < limits).all()
        assert (motion.position(times) > scene.layout.joint_low).all()
        assert (motion.position(times) < scene.layout.joint_high).all()


def test_demonstrations_out_of_reach_are_a_clear_error(rig, tmp_path):
    settings = {"heading_rad": 0.3, "speed_m_s": [8.0, 9.0], "contact_offset_m": 0.0}
    config = {"domain": "hockey", "seed": 0, "count": 64, "waypoints": 17, "duration_s": 0.8, **settings}
    with pytest.raises(InputError, match="narrow heading_rad, speed_m_s"):
        demonstrations.produce(Run(config, {"scene": rig.folders["scene"]}, tmp_path, 1))


def test_latent_is_used_and_near_unit_gaussian(rig):
    quality = pd.read_csv(rig.folders["trajectory_model"] / "quality.csv").set_index("measure")["value"]
    # A dimension that carries less than a nat would be noise; the demonstrations vary in three ways.
    assert (quality["kl_nats"] > 1.0).all()
    assert (quality["latent_mean"].abs() < 0.5).all()
    assert quality["latent_sd"].between(0.6, 1.6).all()
    assert quality["reconstruction_rms"].max() < 0.02


def test_sampled_latents_give_safe_smooth_trajectories(rig):
    check = SafetyCheck(rig.scene)
    latents = np.random.default_rng(5).normal(size=(100, rig.model.sizes.latent))
    reports = [check.report(rig.model.motion(latent)) for latent in latents]
    safe = [r for r in reports if r.safe]
    # This small model decodes a few tails badly; what matters is that most are usable and that none of
    # the unsafe ones is in the pool (next test).
    assert len(safe) >= 80
    assert min(r.clearance for r in safe) >= MIN_CLEARANCE


def test_pool_holds_only_safe_swings(rig):
    check = SafetyCheck(rig.scene)
    assert all(check.report(rig.model.motion(latent)).safe for latent in rig.swings.latents)


def unsafe_motions(rig):
    """name of the broken limit -> a motion that breaks it alone or first."""
    good = rig.model.waypoints(rig.swings.latents[:1])[0]
    beyond = good.copy()
    beyond[:, 5] -= 1.5
    lower = good.copy()
    lower[:, 1] -= 0.25
    kinked = good.copy()
    kinked[8, 6] += 0.05
    return {
        "leaves its range": Motion.through(beyond, 0.8),
        "too close to the board": Motion.through(lower, 0.8),
        "not smooth": Motion.through(kinked, 0.8),
        "too fast": Motion.through(good[::-1][::2], 0.12),
        "not finite": Motion(lambda t, n=0: np.full((len(t), 7), np.nan), 0.8),
    }


@pytest.mark.parametrize(
    "reason", ["leaves its range", "too close to the board", "not smooth", "too fast", "not finite"]
)
def test_unsafe_motion_is_refused_for_the_right_reason(rig, reason):
    report = SafetyCheck(rig.scene).report(unsafe_motions(rig)[reason])
    assert not report.safe
    assert reason in report.reason


def test_executed_swings_stay_within_speed_and_torque(rig):
    swings, usable = execute(rig.scene, rig.model, rig.swings.latents[:6], np.zeros(6, int), 1)
    assert usable.all()
    assert (np.abs(swings.velocities) < np.array(rig.scene.info.speed_limits)).all()
    # With torque limits so low that the servo saturates, the same swings are refused.
    from dataclasses import replace

    weak = replace(rig.scene.info, torque_limits=tuple(t * 0.02 for t in rig.scene.info.torque_limits))
    assert TORQUE_SHARE < 1
    _, usable = execute(replace(rig.scene, info=weak), rig.model, rig.swings.latents[:6], np.zeros(6, int), 1)
    assert not usable.any()


def test_executed_swings_are_those_of_the_whole_scene(rig):
    # With contacts looked for and the object where it waits; the blade's pose by MuJoCo.
    swings, _ = execute(rig.scene, rig.model, rig.swings.latents[:2], np.zeros(2, int), 1)
    model, layout = rig.scene.compile(), rig.scene.layout
    data = mujoco.MjData(model)
    for i in range(2):
        mujoco.mj_resetData(model, data)
        data.qpos[layout.arm_q] = swings.targets[i, 0]
        data.qpos[layout.object_q[0]] = 100.0
        for tick, target in enumerate(swings.targets[i]):
            mujoco.mj_kinematics(model, data)
            assert swings.striker[i, tick] == pytest.approx(data.site_xpos[layout.striker_site], abs=1e-12)
            axis = data.site_xmat[layout.striker_site].reshape(3, 3)[:, 0]
            assert swings.normal[i, tick] == pytest.approx(axis, abs=1e-12)
            row = tick - swings.first[i]
            if 0 <= row < swings.positions.shape[1]:
                assert swings.positions[i, row] == pytest.approx(data.qpos[layout.arm_q], abs=1e-12)
                assert swings.velocities[i, row] == pytest.approx(data.qvel[layout.arm_v], abs=1e-11)
            data.ctrl[: len(target)] = target
            mujoco.mj_step(model, data, round(rig.scene.info.control_period / model.opt.timestep))


def test_arm_tracks_its_commands(rig):
    # Velocity feed-forward leaves the lag of acceleration alone: inertia * a / kp, below 20 mrad here.
    swings = rig.swings
    window = swings.first[:, None] + np.arange(swings.positions.shape[1])
    times = window * rig.scene.info.control_period
    for i in range(5):
        commanded = rig.model.motion(swings.latents[i]).position(times[i])
        assert np.abs(swings.positions[i] - commanded).max() < 0.02


def test_splits_have_disjoint_latents(rig):
    pools = [set(map(tuple, rig.swings.latents[rig.swings.of_split(s)])) for s in SPLITS]
    assert all(pools)
    assert len(set.union(*pools)) == sum(map(len, pools))


def test_striker_reaches_the_object(rig):
    start = np.broadcast_to(np.array(rig.scene.info.start), (len(rig.swings.latents), 2))
    gap = striker_gap(rig.scene, rig.swings.striker, rig.swings.normal, start)
    assert (gap[:, 0] > 0.02).all()
    assert (gap.min(1) < 0).all()


def test_vae_round_trip_and_encoding(rig, tmp_path):
    rig.model.save(tmp_path)
    loaded = TrajectoryVae.load(tmp_path)
    latents = np.random.default_rng(0).normal(size=(20, rig.model.sizes.latent))
    waypoints = rig.model.waypoints(latents)
    assert np.array_equal(loaded.waypoints(latents), waypoints)
    # Encoding what was decoded gives the same trajectory again, to the decoder's noise (4 mrad) and the
    # encoder's own error: a recording's commands can stand for its latents.
    again = rig.model.waypoints(loaded.latents(waypoints))
    assert np.sqrt(((again - waypoints) ** 2).mean()) < 0.012


def test_vae_loss_is_the_negative_evidence_bound_of_a_linear_case():
    # For a linear decoder the bound's terms have closed forms: with q = N(m, s^2) and decoder w z,
    # E|x - w z|^2 = |x - w m|^2 + s^2 |w|^2 and KL = (m^2 + s^2 - 1 - log s^2) / 2.
    mean, log_variance = torch.tensor([[0.7]]), torch.tensor([[-1.2]])
    closed = (0.7**2 + np.exp(-1.2) - 1 + 1.2) / 2
    assert TrajectoryVae.divergence(mean, log_variance).item() == pytest.approx(closed, rel=1e-6)
    # Against the definition, by quadrature.
    z = np.linspace(-12, 12, 200_001)
    s = np.exp(-0.6)
    q = np.exp(-((z - 0.7) ** 2) / (2 * s**2)) / (s * np.sqrt(2 * np.pi))
    log_p = -(z**2) / 2 - np.log(2 * np.pi) / 2
    log_q = -((z - 0.7) ** 2) / (2 * s**2) - np.log(s * np.sqrt(2 * np.pi))
    assert closed == pytest.approx(np.trapezoid(q * (log_q - log_p), z), rel=1e-6)
