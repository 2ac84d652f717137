import mujoco
import numpy as np
import pytest
from slapshot.domains.hockey.model import PUCKS, SPEED_LIMITS, TORQUE_LIMITS
from slapshot.scenes.scene import Scene, set_condition

G = 9.81


def slide_distance(scene: Scene, velocity, condition, condim=4, spin=0.0, timestep=None):
    """Displacement (x, y) in m of a puck pushed off with `velocity` (m/s) on the board."""
    model = scene.compile(timestep)
    values = {"mass": 0.05, "friction_torsional": 0.005, "friction_rolling": 0.0, **condition}
    set_condition(model, scene.layout, values)
    model.pair_dim[scene.layout.object_pair] = condim
    data = mujoco.MjData(model)
    data.qpos[scene.layout.object_q[0]] = 5.0  # away from the blade
    mujoco.mj_step(model, data, round(0.2 / model.opt.timestep))
    begin = data.qpos[scene.layout.object_q[:2]].copy()
    data.qvel[scene.layout.object_v[:2]] = velocity
    data.qvel[scene.layout.object_v[3]] = spin
    mujoco.mj_step(model, data, round(2.5 / model.opt.timestep))
    assert np.abs(data.qvel[scene.layout.object_v]).max() < 1e-3
    return data.qpos[scene.layout.object_q[:2]] - begin


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("mu_x", "mu_y"), [(0.15, 0.19), (0.5, 0.35), (0.95, 0.7)])
@pytest.mark.parametrize("condim", [4, 6])
def test_stopping_distance_along_both_axes(scene, axis, mu_x, mu_y, condim):
    # v^2 / (2 mu g) within 1 %; mu_x acts along x and mu_y along y, so the order is tested as well.
    speed = 1.5
    velocity = np.eye(2)[axis] * speed
    moved = slide_distance(scene, velocity, {"friction_x": mu_x, "friction_y": mu_y}, condim)
    expected = speed**2 / (2 * (mu_x, mu_y)[axis] * G)
    assert moved[axis] == pytest.approx(expected, rel=0.01)
    assert abs(moved[1 - axis]) < 1e-3 * expected


@pytest.mark.parametrize("spin", [0.0, 15.0])
def test_rolling_friction_adds_nothing_to_a_puck_that_stays_flat(scene, spin):
    # A body that cannot tip has no rolling velocity for the friction to act on. The puck's joints leave
    # it none, so table II's largest value moves the rest point by rounding only.
    condition = {"friction_x": 0.4, "friction_y": 0.5}
    without = slide_distance(scene, (1.2, 0.5), condition, condim=4, spin=spin)
    for rolling in (0.01, 0.3):
        rolled = slide_distance(scene, (1.2, 0.5), condition | {"friction_rolling": rolling}, 6, spin)
        assert np.linalg.norm(rolled - without) < 1e-3 * np.linalg.norm(without)


def test_torsional_friction_stops_spin(scene):
    # Pure spin on three rim points of radius R and inertia m R^2 / 2: each point's friction lies on the
    # elliptic cone, so the torque is m g sqrt(R^2 mu^2 + mu_t^2) for isotropic mu.
    mu, mu_t, spin = 0.4, 0.05, 20.0
    model = scene.compile(0.00025)
    condition = {"mass": 0.05, "friction_x": mu, "friction_y": mu}
    set_condition(model, scene.layout, condition | {"friction_torsional": mu_t, "friction_rolling": 0.0})
    data = mujoco.MjData(model)
    data.qpos[scene.layout.object_q[0]] = 5.0
    mujoco.mj_step(model, data, 800)
    yaw, rate = scene.layout.object_q[3], scene.layout.object_v[3]
    begin = float(data.qpos[yaw])
    data.qvel[rate] = spin
    mujoco.mj_step(model, data, 4000)
    radius = scene.info.object_radius
    deceleration = G * np.hypot(radius * mu, mu_t) / (radius**2 / 2)
    turned = float(data.qpos[yaw]) - begin
    # 1 %, as for the slide: what the soft contacts of the board leave.
    assert turned == pytest.approx(spin**2 / (2 * deceleration), rel=0.01)


def test_kinematics_are_the_published_ones(scene):
    # Chain lengths of the LBR 4+: 0.3105, 0.4, 0.39 and 0.078 m; stretched out, the flange is at their sum.
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert data.site("flange").xpos == pytest.approx([0, 0, 0.3105 + 0.4 + 0.39 + 0.078], abs=1e-9)
    # Axes 2, 4 and 6 bent by 90 degrees, an independent sum of vectors.
    data.qpos[scene.layout.arm_q[[1, 3, 5]]] = [np.pi / 2, np.pi / 2, np.pi / 2]
    mujoco.mj_kinematics(model, data)
    x, _, z = data.site("flange").xpos
    assert (abs(x), z) == (pytest.approx(0.4 + 0.078, abs=1e-9), pytest.approx(0.3105 + 0.39, abs=1e-9))
    degrees = np.rad2deg(scene.layout.joint_high)
    assert degrees == pytest.approx([170, 120, 170, 120, 170, 120, 170])
    assert np.rad2deg(SPEED_LIMITS) == pytest.approx([110, 110, 128, 128, 204, 184, 184], abs=0.05)
    assert model.actuator_forcerange[:, 1] == pytest.approx(TORQUE_LIMITS)


def test_arm_weighs_what_the_maker_says(scene):
    model = scene.compile()
    tool = sum(model.body(name).mass[0] for name in ("stick", "blade"))
    puck = model.body("puck").mass[0]
    assert model.body_mass.sum() - tool - puck == pytest.approx(16.0, abs=1e-6)


def test_pucks_have_the_size_of_the_rule_books():
    for puck in PUCKS.values():
        assert 2 * puck.radius == pytest.approx(0.0762)
        assert puck.height == pytest.approx(0.0254)


def test_scene_survives_saving(scene, tmp_path):
    scene.save(tmp_path)
    assert Scene.load(tmp_path) == scene


def test_only_two_contacts_exist(scene):
    model = scene.compile()
    assert model.npair == 2
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
