"""What must not change a verdict: where the axes lie, a hypothesis that fails; and what must be said."""

from dataclasses import replace

import numpy as np
import pytest
from slapshot.arrays import GRAVITY
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.diagnose import diagnose
from slapshot.diagnosis.pucks.fit import gauss_newton
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.launch.on_the_way import OnTheWay
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.selection import level, search
from slapshot.diagnosis.pucks.selection.judgement import robust_covariance
from slapshot.diagnosis.pucks.slide.noise import CameraNoise
from slapshot.diagnosis.pucks.slide.slide_model import SlideModel
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect, Parameter
from slapshot.effects.tilt import Tilt

FRICTION = ((0.35, 0.32, 0.005),)
SETTING = Setting(RADIUS, CAMERA, (0.5, 0.45, 0.01))
# Fields hang on the grid of the board, and stay out; so does the camera's scale, which tracks alone tell
# from friction so badly that where a fit stops is chance.
NAMES = (
    "tilt",
    "linear_drag",
    "quadratic_drag",
    "curl",
    "friction_drift",
    "camera_rotation",
    "lens_distortion",
)
KNOWN = {name: catalogue()[name] for name in NAMES}
SHIFT = np.array([0.4, -0.3])


def turned(points):
    """By a quarter, anticlockwise, and moved."""
    return np.stack([-points[..., 1], points[..., 0]], axis=-1) + SHIFT


@pytest.fixture(scope="module")
def dragged():
    return recording(np.random.default_rng(4), 40, {"linear_drag": {"rate": 0.8}}, friction=FRICTION)


def test_turning_and_moving_recording_and_scene_together_changes_nothing(dragged):
    """By a quarter: friction has axes, which then are exchanged."""
    tracks, hits = dragged.tracks.copy(), dragged.hits.copy()
    tracks[["x", "y"]] = turned(tracks[["x", "y"]].to_numpy())
    for name in ("start", "rest"):
        hits[[f"{name}_x", f"{name}_y"]] = turned(hits[[f"{name}_x", f"{name}_y"]].to_numpy())
    other = replace(dragged, tracks=tracks, hits=hits)
    x, y, torsional = SETTING.friction
    setting = Setting(RADIUS, turned(CAMERA), (y, x, torsional))
    here = diagnose(dragged, SETTING, effects=KNOWN).verdict
    there = diagnose(other, setting, effects=KNOWN).verdict
    assert here.mismatch.found
    assert [set(e.members) for e in there.effects] == [set(e.members) for e in here.effects]
    assert there.effects[0].members == pytest.approx(here.effects[0].members, abs=0.02)
    # Fits stop where an iteration changes the objective by less than 0.02.
    assert there.effects[0].log_evidence == pytest.approx(here.effects[0].log_evidence, abs=0.05)
    assert there.location == here.location
    for scene in here.fit:
        ours, theirs = (verdict.fit[scene].track_rmse_m.value for verdict in (here, there))
        assert theirs == pytest.approx(ours, rel=0.01)


class Broken(Effect):
    """Fails as an effect of one's own may."""

    name = "broken"
    phase = "slide"
    follows = "speed"
    parameters = (Parameter("strength", "1", -1.0, 1.0, 0.1, "of nothing"),)
    physics = "None."
    source = "None."

    def accelerate(self, values, state):
        raise ValueError("no such field")


class Endless(Broken):
    name = "endless"

    def accelerate(self, values, state):
        return values["strength"] * np.inf, np.zeros_like(state.x)


def test_a_hypothesis_that_fails_is_dropped_with_a_line_and_the_rest_goes_on(dragged):
    known = KNOWN | {"broken": Broken(), "endless": Endless()}
    with np.errstate(invalid="ignore"):
        verdict = diagnose(dragged, SETTING, effects=known).verdict
    assert "linear_drag" in verdict.effects[0].members
    notes = " ".join(verdict.notes)
    assert "the hypothesis broken was dropped: its simulation failed (no such field)" in notes
    assert "the hypothesis endless was dropped: its simulation failed (it is not finite)" in notes


def test_a_fit_that_does_not_converge_is_reported(dragged, monkeypatch):
    assert diagnose(dragged, SETTING, effects=KNOWN).verdict.cannot_tell is None
    # A fit that takes one step at a time, and never a small one, goes on as long as it may.
    monkeypatch.setattr(HitFitter, "iterations", 1)
    monkeypatch.setattr(gauss_newton, "CONVERGED", 0.0)
    monkeypatch.setattr(search, "CREEP", 0.0)
    # First without names, since a free form that did not converge seems to explain more; then with them.
    for what in ("the nominal scene", "what was found"):
        verdict = diagnose(dragged, SETTING, effects=KNOWN).verdict
        assert verdict.headline == "cannot_tell"
        assert str(verdict.cannot_tell).startswith(f"the fit of {what} did not converge")
        assert verdict.limits == ()
        assert verdict.fit is None
        monkeypatch.setattr(level, "unnamed_explains_more", lambda *of: False)


def test_intervals_of_90_percent_hold_the_truth_as_often():
    """30 recordings of two slopes: 0.9 +- 3 sqrt(0.09 / 30), slopes of one recording taken for one."""
    truth = {"slope_x": 0.004, "slope_y": -0.006}
    held = []
    for seed in range(30):
        made = recording(np.random.default_rng(200 + seed), 24, {"tilt": truth}, friction=FRICTION)
        model = SlideModel(hit_tracks(made), {"tilt": Tilt()}, RADIUS, CAMERA)
        fitter = HitFitter(model, CameraNoise(0.003, 0.0))
        fit = fitter.fit(fitter.start(), effects=["tilt"])
        sd = np.sqrt(np.diag(robust_covariance(fit)))
        for c, column in enumerate(fit.columns):
            if column.owner == "tilt":
                off = fit.point.effects["tilt"][column.parameter] - truth[column.parameter]
                held.append(abs(off) < 1.645 * sd[c])
    assert abs(np.mean(held) - 0.9) < 3 * np.sqrt(0.09 / 30)


def test_on_the_way_a_slope_moves_by_half_its_pull_times_the_square_of_the_time():
    launches = np.array([[0.6, 0.0, 1.5, 0.0, 0.0], [0.6, 0.1, 1.2, 0.5, 0.0]])
    way, slope = np.array([0.05, 0.08]), 0.02
    friction = np.tile([0.3, 0.3, 0.005], (2, 1))
    tilt = [(Tilt(), {"slope_x": slope, "slope_y": 0.0})]
    shift = OnTheWay(launches, way, np.zeros(2), friction).shift(tilt, friction)
    pull = -GRAVITY * slope
    # Along the motion friction is the same with and without; across it a turn of the path is of second order.
    assert shift[0, 0] == pytest.approx(pull * way[0] ** 2 / 2, rel=1e-3)
    assert shift[0, 2] == pytest.approx(pull * way[0], rel=1e-3)
    assert shift[:, 4] == pytest.approx([0.0, 0.0])
    harder = np.tile([0.4, 0.4, 0.005], (2, 1))
    slower = OnTheWay(launches, way, np.zeros(2), friction).shift([], harder)
    assert slower[0, 0] == pytest.approx(-0.1 * GRAVITY * way[0] ** 2 / 2, rel=1e-3)
