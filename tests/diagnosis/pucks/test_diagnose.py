"""Whole diagnoses of recordings made with the slide law itself: known answers in both directions."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.selection.search import DRAWS
from slapshot.effects.catalogue import catalogue

SETTING = Setting(RADIUS, CAMERA, (0.5, 0.5, 0.01))


def diagnosed(effects, seed=1, **settings):
    made = recording(np.random.default_rng(seed), effects=effects, **{"hits": 60} | settings)
    return diagnose(made, SETTING, threads=2).verdict


@pytest.fixture(scope="module")
def dragged():
    return diagnosed({"linear_drag": {"rate": 0.5}}, friction=((0.35, 0.32, 0.005), (0.25, 0.25, 0.005)))


def test_nothing_is_found_where_nothing_is_missing():
    verdict = diagnosed({}, noise_time=0.02, mistracks=0.01)
    assert not verdict.mismatch.found
    assert verdict.effects == ()
    assert verdict.location.phase is None
    assert verdict.noise_sd_m == pytest.approx(0.003, rel=0.1)
    assert verdict.limits


def test_drag_is_named_with_what_cannot_be_told_from_it(dragged):
    (found,) = dragged.effects
    assert dragged.mismatch.p_value == 1 / (DRAWS + 1)  # the least that there is
    assert "linear_drag" in found.members
    assert set(found.members) <= {"linear_drag", "quadratic_drag", "stribeck_friction"}
    assert sum(found.members.values()) + dragged.unknown.probability == pytest.approx(1)
    assert (dragged.location.phase, dragged.location.variable) == ("slide", "speed")
    assert not dragged.unknown.flagged


def test_the_fit_of_held_out_hits_improves_to_the_noise_floor(dragged):
    fit = dragged.fit
    assert fit["augmented"].loglik_per_hit.low > 0
    floor = fit["noise_floor"].track_rmse_m.value
    assert fit["augmented"].track_rmse_m.value < 1.3 * floor
    assert fit["nominal"].track_rmse_m.value > 2 * floor


def test_rivals_get_hits_that_would_part_them(dragged):
    assert all(h.nats > 0 for h in dragged.next_hits)
    assert len(dragged.effects[0].members) == 1 or dragged.next_hits


def test_a_tilt_is_found_with_its_slope():
    verdict = diagnosed({"tilt": {"slope_x": 0.0, "slope_y": 0.01}}, hits=80)
    (found,) = verdict.effects
    assert found.name == "tilt"
    slope = {p.name: p for p in found.parameters}
    assert slope["slope_y"].low < 0.01 < slope["slope_y"].high
    assert slope["slope_y"].low > 0


def test_a_catalogue_may_hold_the_effect_that_is_there_and_no_other():
    made = recording(np.random.default_rng(1), 60, {"linear_drag": {"rate": 0.5}})
    verdict = diagnose(made, SETTING, effects={"linear_drag": catalogue()["linear_drag"]}, threads=2).verdict
    (found,) = verdict.effects
    (rate,) = found.parameters
    assert found.members == {"linear_drag": 1 - verdict.unknown.probability}
    assert rate.low < 0.5 < rate.high


def test_the_same_seed_gives_the_same_verdict_whatever_the_order_of_rows(dragged):
    settings = {"hits": 60, "friction": ((0.35, 0.32, 0.005), (0.25, 0.25, 0.005))}
    made = recording(np.random.default_rng(1), effects={"linear_drag": {"rate": 0.5}}, **settings)
    shuffled = replace(
        made,
        hits=made.hits.sample(frac=1, random_state=3).reset_index(drop=True),
        tracks=made.tracks.sample(frac=1, random_state=3).sort_values("t", kind="stable"),
    )
    again = diagnose(shuffled, SETTING, threads=1).verdict
    assert dataclasses.asdict(again) == dataclasses.asdict(dragged)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"hits": 8}, "record at least 12"),
        ({"rate": 8.0}, "more frames a second"),
        ({"heading": 1e-3, "speed": (1.5, 1.501)}, "vary headings and speeds"),
        ({"speed": (0.1, 0.2)}, "hit harder"),
    ],
)
def test_a_recording_that_cannot_carry_a_diagnosis_is_told_what_to_record(settings, words):
    verdict = diagnosed({}, **settings)
    assert words in verdict.cannot_tell
    assert verdict.mismatch is None
    assert verdict.effects == ()


def test_rest_points_alone_cannot_tell():
    made = replace(recording(np.random.default_rng(1), hits=20), tracks=None)
    assert "record tracks" in diagnose(made, SETTING).verdict.cannot_tell
