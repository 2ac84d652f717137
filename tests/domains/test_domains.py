"""What every domain with a robot must do, whatever the robot: one contract for all of them."""

import subprocess
import sys
from typing import get_args

import mujoco
import numpy as np
import pytest
from slapshot.config.scene import PuckName
from slapshot.diagnosis.pucks.augmented import augmented_scene
from slapshot.domains.hockey.model import PUCKS
from slapshot.scenes.domain import PARTS, build_scene, load_domain, load_part, part_module, scene_settings
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.swings import SPLITS
from slapshot.validation import validated, values_of


def test_a_scene_survives_being_saved(bench):
    assert bench.loaded == bench.scene
    first, second = (mujoco.mj_sizeModel(s.compile()) for s in (bench.loaded, bench.scene))
    assert first == second


def test_a_scene_can_be_edited_and_written_with_its_files(bench):
    """Meshes and included files among them; XML has six digits."""
    model = bench.scene.compile()
    for other in (bench.scene.spec().compile(), augmented_scene(bench.scene, {}).compile()):
        assert (other.nq, other.nbody, other.nmesh) == (model.nq, model.nbody, model.nmesh)
        np.testing.assert_allclose(other.body_mass, model.body_mass, rtol=1e-5)


def test_the_same_settings_give_the_same_scene(bench):
    assert build_scene(bench.config.scene) == bench.scene


def test_tasks_are_within_their_ranges_and_demonstrations_have_the_shape_of_commands(bench):
    domain, settings = load_domain(bench.name), bench.config.demonstrations
    rng = np.random.default_rng(0)
    tasks = [domain.draw_task(settings, rng) for _ in range(64)]
    low, high = settings.speed_m_s
    assert all(low <= task["speed"] <= high for task in tasks)
    assert all(abs(task["heading"]) <= settings.heading_rad for task in tasks)
    found = [d for d in domain.demonstrate(bench.scene, settings, tasks) if d is not None]
    assert len(found) > 48
    assert {d.shape for d in found} == {(settings.waypoints, bench.scene.info.commands)}
    check = load_part(bench.name, "safety").SafetyCheck(bench.scene)
    reports = [check.report(Motion.through(d, settings.duration_s)) for d in found]
    assert np.mean([r.safe for r in reports]) > 0.9
    assert all(0 < r.speed_share <= 1 for r in reports if r.safe)


def test_what_is_not_finite_or_too_fast_is_refused(bench):
    check = load_part(bench.name, "safety").SafetyCheck(bench.scene)
    settings = bench.config.demonstrations
    task = load_domain(bench.name).draw_task(settings, np.random.default_rng(1))
    (waypoints,) = load_domain(bench.name).demonstrate(bench.scene, settings, [task])
    assert check.report(Motion.through(waypoints, settings.duration_s)).safe
    middle = waypoints.mean(0)
    fast = Motion.through(middle + 5 * (waypoints - middle), settings.duration_s)
    assert not check.report(fast).safe


def test_swings_are_those_of_their_latents_and_splits_share_none(bench):
    swings, info = bench.swings, bench.scene.info
    count = len(swings.latents)
    assert {len(value) for value in vars(swings).values()} == {count}
    assert all(np.isfinite(value).all() for value in vars(swings).values())
    assert swings.targets.shape[2] == info.commands
    assert swings.poses.shape[2] == swings.positions.shape[2] == len(info.joints)
    assert set(swings.splits) == set(range(len(SPLITS)))
    assert len(np.unique(swings.latents, axis=0)) == count
    times = swings.pose_times(info.control_period)
    assert times[-1] <= swings.targets.shape[1] * info.control_period
    execute = load_part(bench.name, "execution").execute
    again, usable = execute(bench.scene, bench.model, swings.latents[:3], swings.splits[:3], 1)
    assert usable.all()
    np.testing.assert_allclose(again.starts, swings.starts[:3], atol=1e-9)
    np.testing.assert_array_equal(again.targets, swings.targets[:3])


def test_outcomes_depend_on_the_hit_alone(bench):
    collector = load_part(bench.name, "collector").Collector(bench.scene, bench.swings, 1, size=4)
    hits = bench.hits(10)
    together = collector.collect(hits)
    order = np.random.default_rng(0).permutation(10)
    shuffled = collector.collect(hits.rows(order))
    for name, values in vars(together).items():
        np.testing.assert_allclose(getattr(shuffled, name), values[order], atol=1e-12, err_msg=name)


def test_tracks_lead_from_the_start_to_rest(bench):
    collector = load_part(bench.name, "collector").Collector(bench.scene, bench.swings, 1)
    hits = bench.hits(8)
    period = max(0.02, bench.scene.info.control_period)
    outcomes, tracks = collector.collect_with_tracks(hits, period)
    plain = collector.collect(hits)
    np.testing.assert_array_equal(outcomes.rests, plain.rests)
    for i, track in enumerate(tracks):
        assert np.diff(track[:, 0]) == pytest.approx(period)
        begin = bench.swings.starts[hits.swings[i]] + hits.start_errors[i]
        assert track[0, 1:3] == pytest.approx(begin, abs=1e-3)
        assert track[-1, 1:3] == pytest.approx(outcomes.rests[i, :2], abs=2e-3)
        assert track[-1, 0] == pytest.approx(outcomes.launch_times[i] + outcomes.durations[i], abs=2 * period)


def test_less_friction_lets_it_slide_farther(bench):
    collector = load_part(bench.name, "collector").Collector(bench.scene, bench.swings, 1)
    hits = bench.hits(12)
    moved = []
    for friction in (0.6, 0.3, 0.15):
        ones = np.full(12, friction)
        hits.conditions.update(friction_x=ones, friction_y=ones)
        rests = collector.collect(hits).rests[:, :2]
        moved.append(np.linalg.norm(rests - bench.swings.starts[hits.swings] - hits.start_errors, axis=1))
    assert (np.diff(np.median(moved, axis=1)) > 0).all()
    assert np.median(moved[2]) > 1.5 * np.median(moved[0])


@pytest.mark.parametrize("part", PARTS)
def test_a_domain_without_a_part_of_its_own_has_the_common_one(part):
    assert part_module("hockey", part) == PARTS[part]
    assert part_module("fetchslide", part) == f"slapshot.domains.fetchslide.{part}"


def test_settings_are_checked_without_mujoco():
    """Planning and a configuration's check import them, on machines where MuJoCo may be broken."""
    code = (
        "import sys\n"
        "from slapshot.config.scene import FetchslideScene, HockeyScene\n"
        "from slapshot.domains.table.settings import TableScene\n"
        "print(*sorted({'torch', 'mujoco', 'dm_control', 'scipy'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_configurations_scenes_fit_the_models_of_their_domains(bench):
    model = scene_settings(load_domain(bench.name))
    validated(model, values_of(bench.config.scene), "scene")


def test_every_puck_that_may_be_named_is_there():
    assert set(get_args(PuckName)) == set(PUCKS)
