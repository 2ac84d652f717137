import numpy as np
import pytest
from slapshot.rollouts.collector import Collector
from slapshot.rollouts.hits import Hits
from slapshot.rollouts.reference import dm_control_rests, reference_rests


def test_rest_points_against_the_whole_arm_at_a_quarter_millisecond(rig, make_hits):
    hits = make_hits(60, seed=4)
    fast = Collector(rig.scene, rig.swings, 1).collect(hits).rests[:, :2]
    error = np.linalg.norm(fast - reference_rests(rig.scene, rig.swings, hits, 0.00025), axis=1)
    # The benchmark's bound (12 mm), with hops that part two solutions left to the tail.
    assert np.median(error) < 0.012
    assert np.quantile(error, 0.9) < 0.06


def test_against_the_whole_arm_at_the_same_step(rig, make_hits):
    # Nothing but the slide differs: what remains is the millimetres that a puck's last hop decides.
    hits = make_hits(30, seed=5)
    fast = Collector(rig.scene, rig.swings, 1).collect(hits).rests[:, :2]
    slow = dm_control_rests(rig.scene, rig.swings, hits)
    assert np.median(np.linalg.norm(fast - slow, axis=1)) < 0.006


def test_a_hit_does_not_depend_on_the_others_nor_on_threads(rig, make_hits):
    hits = make_hits(40, seed=6)
    whole = Collector(rig.scene, rig.swings, 2, size=64).collect(hits)
    parts = Collector(rig.scene, rig.swings, 1, size=7).collect(hits)
    for name in vars(whole):
        assert np.array_equal(getattr(whole, name), getattr(parts, name)), name
    last = Collector(rig.scene, rig.swings, 1).collect(hits.rows(slice(39, 40)))
    assert np.array_equal(last.rests[0], whole.rests[39])


def test_heavier_friction_stops_earlier(rig, make_hits):
    hits = make_hits(20, seed=7)
    distance = []
    for friction in (0.2, 0.4, 0.8):
        conditions = hits.conditions | {k: np.full(20, friction) for k in ("friction_x", "friction_y")}
        outcome = Collector(rig.scene, rig.swings, 1).collect(
            Hits(hits.swings, conditions, np.zeros((20, 2)))
        )
        distance.append(np.linalg.norm(outcome.rests[:, :2] - rig.scene.info.start, axis=1))
    assert (distance[0] > distance[1]).all()
    assert (distance[1] > distance[2]).all()


def test_tracks_agree_with_outcomes(rig, make_hits):
    hits = make_hits(12, seed=8)
    collector = Collector(rig.scene, rig.swings, 1)
    outcomes, tracks = collector.collect_with_tracks(hits, 0.02)
    assert np.array_equal(outcomes.rests, collector.collect(hits).rests)
    for i, track in enumerate(tracks):
        assert (np.diff(track[:, 0]) > 0).all()
        assert track[0, 1:3] == pytest.approx(hits.start_errors[i] + rig.scene.info.start, abs=1e-3)
        # The last sample is at most a period before rest; by then the puck creeps.
        assert track[-1, 1:3] == pytest.approx(outcomes.rests[i, :2], abs=0.02)
        # No jump where the contact phase hands over to the slide: nothing moves faster than 4 m/s.
        assert np.linalg.norm(np.diff(track[:, 1:3], axis=0), axis=1).max() < 4 * 0.02
