"""Rest points alone: recordings made with the slide law, their launches known but for scatter."""

from dataclasses import replace

import numpy as np
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.fit.rest_fit import RestFitter
from slapshot.diagnosis.pucks.selection.free_form import FREE_FORMS, FREE_LAUNCH, NominalLaunches
from slapshot.diagnosis.pucks.selection.judgement import robust_covariance
from slapshot.diagnosis.pucks.selection.level import examine
from slapshot.diagnosis.pucks.selection.search import Search
from slapshot.diagnosis.pucks.slide.slide_model import SlideModel
from slapshot.diagnosis.pucks.slide.tracks import rest_tracks
from slapshot.effects.catalogue import catalogue
from slapshot.effects.slide_law import ActiveEffect, slide

FRICTION = (0.35, 0.32, 0.005)
ALONG, ACROSS = 0.08, 0.05  # scatter as a share of the distance
NAMES = ("tilt", "linear_drag", "friction_drift", "curl")
KNOWN = {name: catalogue()[name] for name in NAMES} | {e.name: e for e in FREE_FORMS if e.name == FREE_LAUNCH}


class Launches:
    """Launches that no effect here changes."""

    def __init__(self, mean):
        self.mean = mean

    def means(self, point):
        return self.mean

    def slopes(self, columns, point):
        slopes = np.zeros((*self.mean.shape, len(columns)))
        for c, column in enumerate(columns):
            if column.owner == FREE_LAUNCH:
                names = [p.name for p in KNOWN[FREE_LAUNCH].parameters]
                of = NominalLaunches(
                    self.mean, np.zeros((len(self.mean), 5, 0)), np.zeros((len(self.mean), 2))
                )
                slopes[:, :, c] = KNOWN[FREE_LAUNCH].basis(of)[:, :, names.index(column.parameter)]
        return slopes


def fitter(rng, hits=150, effects=None):
    """Of hits whose rest points scatter about those of their launches."""
    angle, speed = rng.uniform(-1.2, 1.2, hits), rng.uniform(1.0, 2.2, hits)
    zero = np.zeros(hits)
    launches = np.column_stack(
        [zero + 0.55, zero, zero, speed * np.cos(angle), speed * np.sin(angle), rng.normal(0, 2, hits)]
    )
    order = np.arange(hits) / (hits - 1) - 0.5
    rows = np.arange(hits)
    acting = [
        ActiveEffect(catalogue()[name], rows, {k: np.full(hits, x) for k, x in values.items()})
        for name, values in (effects or {}).items()
    ]
    rests = slide(launches, np.tile(FRICTION, (hits, 1)), RADIUS, 0.1, acting, order).rests
    way = rests - launches[:, :2]
    left = np.stack([-way[:, 1], way[:, 0]], axis=1)
    rests = rests + rng.normal(0, ALONG, (hits, 1)) * way + rng.normal(0, ACROSS, (hits, 1)) * left
    made = recording(np.random.default_rng(0), hits)
    table = made.hits.assign(rest_x=rests[:, 0], rest_y=rests[:, 1])
    tracks = rest_tracks(replace(made, hits=table, tracks=None))
    model = SlideModel(tracks, KNOWN, RADIUS, CAMERA)
    return RestFitter(model, Launches(launches[:, [0, 1, 3, 4, 5]]), KNOWN, np.array(FRICTION))


def examined(rng, **settings):
    search = Search(fitter(rng, **settings), NAMES, [FREE_LAUNCH], np.random.default_rng(5), most=1)
    return examine(search)


def test_scatter_is_told_along_and_across_the_way():
    made = fitter(np.random.default_rng(1), 400)
    scatter = made.fit(made.start()).scatter
    # A standard deviation of n values has the relative standard error 1 / sqrt(2 n); tails weigh less.
    error = 1 / np.sqrt(2 * 400)
    assert np.sqrt(np.diag(scatter)) == pytest.approx([ALONG, ACROSS], rel=4 * error + 0.03)


def test_hits_that_the_simulation_misses_do_not_end_a_diagnosis():
    """They stay where they lie: two of 150 that go wrong, one of which was missed indeed."""
    whole, some = (fitter(np.random.default_rng(1)) for _ in range(2))
    some._launches.mean[[3, 50], 2:] = 0.0
    some.measured[50] = some._launches.mean[50, :2]
    sd = [np.sqrt(np.diag(of.fit(of.start()).scatter)) for of in (whole, some)]
    assert sd[1] == pytest.approx(sd[0], rel=0.1)


def test_a_tilt_is_found_and_nothing_where_nothing_is():
    tilted = examined(np.random.default_rng(2), effects={"tilt": {"slope_x": 0.0, "slope_y": 0.03}})
    assert tilted.mismatch.found
    assert tilted.final.effects == ("tilt",)
    assert tilted.final.fit.point.effects["tilt"]["slope_y"] == pytest.approx(0.03, abs=0.01)
    for seed in (3, 4, 5):
        assert not examined(np.random.default_rng(seed)).mismatch.found


def test_intervals_of_90_percent_hold_the_truth_as_often():
    """30 recordings of two slopes: 0.9 +- 3 sqrt(0.09 / 30), slopes of one recording taken for one."""
    truth = {"slope_x": 0.01, "slope_y": 0.02}
    held = []
    for seed in range(30):
        made = fitter(np.random.default_rng(100 + seed), 80, {"tilt": truth})
        fit = made.fit(made.start(), None, ["tilt"])
        sd = np.sqrt(np.diag(robust_covariance(fit)))
        for c, column in enumerate(fit.columns):
            if column.owner == "tilt":
                off = fit.point.effects["tilt"][column.parameter] - truth[column.parameter]
                held.append(abs(off) < 1.645 * sd[c])
    assert abs(np.mean(held) - 0.9) < 3 * np.sqrt(0.09 / 30)
