"""FetchSlide held against the environment that it is taken from, and against closed forms."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
from slapshot.config.scene import SceneSettings
from slapshot.config.trajectories import ScriptedHits
from slapshot.domains.fetchslide import build_scene, demonstrate, model
from slapshot.domains.fetchslide.collector import Collector, PucksAlone
from slapshot.domains.fetchslide.demonstrations import RESPONSE, commands_of, draw_task
from slapshot.domains.fetchslide.gripper import PUCK_HOME, Grippers, prepare
from slapshot.domains.fetchslide.reference import environment_rests, make_environment
from slapshot.domains.fetchslide.safety import SafetyCheck
from slapshot.errors import InputError
from slapshot.trajectories.motion import Motion

G = 9.81
HITS = 60
OWN_FRICTION = np.array([0.1, 0.005, 0.0001])


@pytest.fixture(scope="module")
def environment():
    return make_environment()


@pytest.fixture(scope="module")
def rests(fetchslide):
    """The same hits by our collector, by the environment, and by the environment with the puck 1 nm aside."""
    hits = fetchslide.hits(HITS, seed=5)
    ours = Collector(fetchslide.scene, fetchslide.swings, 1).collect(hits).rests[:, :2]
    theirs = environment_rests(fetchslide.swings, hits)
    moved = environment_rests(fetchslide.swings, replace(hits, start_errors=hits.start_errors + 1e-9))
    return ours, theirs, moved


def test_the_model_is_the_package_s_own(fetchslide):
    folder = Path(find_spec("gymnasium_robotics").origin).parent / "envs/assets/fetch"
    theirs, ours = mujoco.MjModel.from_xml_path(str(folder / "slide.xml")), fetchslide.scene.compile()
    for name in ("body_mass", "body_inertia", "dof_damping", "geom_friction", "geom_solref", "mesh_vert"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    assert (ours.opt.timestep, ours.opt.cone) == (0.002, mujoco.mjtCone.mjCONE_PYRAMIDAL)


def test_constants_are_those_of_the_model(fetchslide):
    compiled = fetchslide.scene.compile()
    assert compiled.geom(model.OBJECT).size[:2] == pytest.approx([model.PUCK_RADIUS, model.PUCK_HEIGHT / 2])
    table, body = compiled.geom(model.TABLE), compiled.body(model.TABLE)
    assert table.size[:2] == pytest.approx(model.TABLE_HALF)
    assert body.pos[:2] == pytest.approx(model.TABLE_MIDDLE)
    assert body.pos[2] + table.size[2] == pytest.approx(model.TABLE_HEIGHT)
    assert compiled.opt.timestep * model.SUBSTEPS == pytest.approx(model.CONTROL_PERIOD)
    finger = compiled.geom("robot0:r_gripper_finger_link")
    assert finger.size[2] == pytest.approx(model.FINGER_HALF_THICKNESS)


def test_a_hit_begins_in_the_state_that_the_environment_resets_to(fetchslide, environment):
    qpos, qvel = prepare(fetchslide.scene.compile())
    np.testing.assert_allclose(qpos, environment.initial_qpos, atol=1e-12)
    np.testing.assert_allclose(qvel, environment.initial_qvel, atol=1e-12)
    assert environment.initial_gripper_xpos == pytest.approx(model.GRIP_START, abs=5e-4)


def test_commands_do_what_the_environment_s_step_does(fetchslide, environment):
    """Without contact there is nothing to amplify a difference: equal to a micrometre."""
    swing, ids = 0, np.arange(1)
    environment.reset(seed=0)
    environment.data.qpos[environment.model.joint(model.OBJECT_JOINT).qposadr[0] :][:2] = PUCK_HOME[:2]
    mujoco.mj_forward(environment.model, environment.data)
    robots = Grippers(fetchslide.scene, 1, 1)
    robots.reset(ids, PUCK_HOME[None, :2], OWN_FRICTION)
    for command in fetchslide.swings.targets[swing]:
        environment.step(np.append(command, 0.0))
        robots.command(ids, command[None])
        assert robots.grip(ids)[0] == pytest.approx(environment.data.site("robot0:grip").xpos, abs=1e-6)


def test_pucks_end_where_the_environment_s_do(rests):
    """The tolerance is the environment's own: what a nanometre does to its end points, times three.

    Medians and 90 % quantiles of 60 heavy-tailed distances differ by chance by up to a factor of two.
    """
    ours, theirs, moved = rests
    off, own = (1e3 * np.linalg.norm(r - theirs, axis=1) for r in (ours, moved))
    assert np.median(off) < max(3 * np.median(own), 0.5)
    assert np.quantile(off, 0.9) < max(3 * np.quantile(own, 0.9), 3.0)
    assert np.median(off) < 2.0  # mm
    assert np.quantile(off, 0.9) < 10.0


def test_end_points_scatter_about_the_environment_s_and_are_not_shifted(rests):
    ours, theirs, _ = rests
    off = ours - theirs
    error = 1.2533 * 1.4826 * np.median(np.abs(off), axis=0) / np.sqrt(HITS)  # of a median
    assert (np.abs(np.median(off, axis=0)) < 4 * error + 1e-5).all()


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("axis", [0, 1])
def test_along_an_axis_a_puck_stops_after_v_squared_over_2_mu_g(fetchslide, friction, axis):
    """Pyramidal cones have full friction along their axes; a puck that hops slides up to 15 % farther."""
    speed = 0.6
    poses = np.array([[*model.TABLE_MIDDLE, 0.42, 1, 0, 0, 0]], float)
    velocities = np.zeros((1, 6))
    velocities[0, axis] = speed
    slid, periods = PucksAlone(fetchslide.scene, 1, 1).slide(
        poses, velocities, np.array([[friction, 0.005, 0.0001]])
    )
    moved = slid[0, periods[0], :2] - slid[0, 0, :2]
    assert moved[axis] == pytest.approx(speed**2 / (2 * friction * G), rel=0.15)
    assert abs(moved[1 - axis]) < 0.05 * moved[axis]


def test_a_puck_that_leaves_the_table_rests_where_it_left(fetchslide):
    poses = np.array([[1.8, 0.75, 0.42, 1, 0, 0, 0]], float)
    velocities = np.array([[2.0, 0, 0, 0, 0, 0]])
    slid, periods = PucksAlone(fetchslide.scene, 1, 1).slide(
        poses, velocities, np.array([[0.05, 0.005, 0.0001]])
    )
    edge = model.TABLE_MIDDLE[0] + model.TABLE_HALF[0]
    assert slid[0, periods[0], 0] == pytest.approx(edge, abs=2.0 * model.CONTROL_PERIOD)
    assert (np.diff(slid[0, : periods[0] + 1, 0]) >= 0).all()


def test_the_response_to_a_command_is_the_measured_one(fetchslide):
    robots, ids = Grippers(fetchslide.scene, 1, 1), np.arange(1)
    robots.reset(ids, PUCK_HOME[None, :2], OWN_FRICTION)
    for _ in range(4):
        robots.command(ids, np.array([[0.0, 0.0, 0.2]]))
    track = []
    for _ in range(8):
        robots.command(ids, np.array([[0.5, 0.0, 0.0]]))
        track.append(robots.grip(ids)[0, 0])
    speed = np.diff(track)[2:].mean() / model.CONTROL_PERIOD
    assert speed / 0.5 == pytest.approx(RESPONSE, rel=0.05)


def test_the_gripper_does_not_touch_the_puck_before_the_cached_state(fetchslide):
    swings, info = fetchslide.swings, fetchslide.scene.info
    for swing in range(len(swings.latents)):
        before = swings.striker[swing, : swings.first[swing] + 1, :2]
        corner = np.hypot(info.striker_half_thickness, 0.015)  # of the two closed fingers
        gap = np.linalg.norm(before - swings.starts[swing], axis=1).min()
        assert gap > info.object_radius + corner


def test_a_puck_that_lies_nearer_is_simulated_from_an_earlier_state(fetchslide):
    """Alone a gripper moves as beside a puck it does not touch: rests are those from the first state."""
    swings, radius = fetchslide.swings, fetchslide.scene.info.object_radius
    hits = fetchslide.hits(40, seed=8)
    ahead = swings.normal[hits.swings, swings.first[hits.swings], :2]
    nearer = replace(hits, start_errors=-0.02 * ahead)
    from_first = replace(swings, positions=swings.positions[:, :1], velocities=swings.velocities[:, :1])
    skipped = {}
    for name, these in (("nominal", hits), ("nearer", nearer)):
        collector = Collector(fetchslide.scene, swings, 1)
        places = swings.starts[these.swings] + these.start_errors
        skipped[name] = collector._last_clear(these.swings, places)
        ticks = swings.first[these.swings] + skipped[name]
        gap = np.linalg.norm(swings.striker[these.swings, ticks, :2] - places, axis=1)
        assert gap.min() > radius + np.hypot(fetchslide.scene.info.striker_half_thickness, 0.015)
        rests = (c.collect(these).rests for c in (collector, Collector(fetchslide.scene, from_first, 1)))
        off = 1e3 * np.linalg.norm(np.subtract(*(r[:, :2] for r in rests)), axis=1)
        assert np.median(off) < 2.0  # mm, as far as contact is chaotic
    assert (skipped["nearer"] <= skipped["nominal"]).all()
    assert skipped["nearer"].mean() < skipped["nominal"].mean()


def test_hardly_a_puck_leaves_the_table(fetchslide):
    """About one in a thousand does: the fastest pushes under the least friction."""
    outcomes = Collector(fetchslide.scene, fetchslide.swings, 1).collect(fetchslide.hits(200, seed=7))
    beyond = np.abs(outcomes.rests[:, :2] - model.TABLE_MIDDLE) > np.array(model.TABLE_HALF)
    assert beyond.any(1).sum() <= 4
    assert (np.abs(outcomes.rests[:, :2] - model.TABLE_MIDDLE) < np.array(model.TABLE_HALF) + 0.1).all()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda c: np.where(np.abs(c) == np.abs(c).max(), 1.2, c), "a command is too fast"),
        (lambda c: c * np.tile([1, -1], 12)[:, None], "the commands are not smooth"),
        (lambda c: c - np.array([0, 0, 0.05]), "too close to the table"),
        (lambda c: c + np.array([0, 0, 0.05]), "too high to meet the puck"),
        (lambda c: c * [0, 0, 1] + np.array([0, -0.99, 0]), "beyond the table's edge"),
        (lambda c: c + np.nan, "not finite"),
    ],
)
def test_every_limit_is_looked_at(fetchslide, change, reason):
    task = {"x": 1.12, "y": 0.75, "heading": 0.1, "speed": 0.7, "contact_offset": 0.0}
    commands = commands_of(task, 24)
    check = SafetyCheck(fetchslide.scene)
    assert check.report(_motion(commands)).safe
    assert check.report(_motion(change(commands))).reason == reason


def _motion(commands):
    try:
        return Motion.through(commands, 0.92)
    except ValueError:  # a spline takes no NaN
        motion = Motion.through(np.zeros_like(commands), 0.92)
        return replace(motion, spline=lambda times, order=0: np.full((len(times), 3), np.nan))


def test_commands_of_another_period_are_refused(fetchslide):
    settings = ScriptedHits.from_parts(fetchslide.config.demonstrations, duration_s=1.0)
    task = draw_task(settings, np.random.default_rng(0))
    with pytest.raises(InputError, match=r"demonstrations\.duration_s: 24 waypoints .* write 0\.92"):
        demonstrate(fetchslide.scene, settings, [task])


def test_without_the_package_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="needs the scene of gymnasium-robotics, which is not installed"):
        build_scene(SceneSettings(domain="fetchslide"))
