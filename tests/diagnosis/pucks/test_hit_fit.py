"""The likelihood of a hit, against dense algebra and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from slapshot.arrays import GRAVITY
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.inference.mismatch_test import Elimination, Scores, group_statistics, mismatch_test
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter, Scatter, with_readings
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.launch.encoders import Encoders
from slapshot.diagnosis.pucks.launch.execution import Execution
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel, weighted_projection
from slapshot.diagnosis.pucks.launch.launch_prior import UnknownLaunch
from slapshot.diagnosis.pucks.launch.strikes import TIMESTEP, _told_at
from slapshot.diagnosis.pucks.selection.law_error import with_law_errors
from slapshot.diagnosis.pucks.slide.camera_view import start_shift
from slapshot.diagnosis.pucks.slide.noise import CameraNoise
from slapshot.diagnosis.pucks.slide.slide_model import Column, Point, SlideModel
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect, Parameter

HITS = 6
SCATTER = np.diag([0.004, 0.003, 0.05, 0.04, 0.5]) ** 2


class KnownLaunch(UnknownLaunch):
    """Launches whose means are given, and follow a slope along y as after a second on it."""

    flat = 0

    def offsets(self, point):
        means = self.means.copy()
        means[:, 3] -= GRAVITY * point.effects.get("tilt", {"slope_y": 0.0})["slope_y"]
        return means - point.latents[:, :5]

    def slopes(self, columns, point):
        slopes = np.zeros((self.count, 5, len(columns)))
        slopes[:, 3, [c for c, column in enumerate(columns) if column.parameter == "slope_y"]] = -GRAVITY
        return slopes

    def roots(self, scatter, measured, noise):
        root = np.linalg.cholesky(np.linalg.inv(scatter)).T
        return np.tile(root, (self.count, 1, 1)), np.full(self.count, np.linalg.slogdet(scatter)[1])

    def scatter(self, point, measured, noise, before):
        return before


@pytest.fixture(scope="module")
def fitter():
    tracks = hit_tracks(recording(np.random.default_rng(5), HITS, spin_sd=0.5))
    model = SlideModel(tracks, {"tilt": catalogue()["tilt"]}, RADIUS, CAMERA)
    return HitFitter(model, CameraNoise(0.003, 0.0))


def test_the_marginal_likelihood_is_that_of_dense_gaussians(fitter):
    """Where all is linear, frames are N(f + H m, H P H' + R) once launches are integrated out."""
    fit = fitter.fit(fitter.start())
    launches = KnownLaunch(len(fit.point.latents))
    object.__setattr__(launches, "means", fit.point.latents[:, :5] + [0.002, -0.001, 0.03, -0.02, 0.2])
    own = fitter.about(launches)
    z, h, _ = own._whitened(*own.model.derivatives(fit.point, []))
    valid = own.valid.repeat(2, axis=1)
    offset = np.column_stack([launches.offsets(fit.point), -fit.point.latents[:, 5]])

    def dense(scatter):
        spread = np.zeros((6, 6))
        spread[:5, :5], spread[5, 5] = scatter.launch, scatter.friction**2
        total = 0.0
        for i in range(len(z)):
            rows = valid[i]
            covariance = h[i][rows] @ spread @ h[i][rows].T + np.eye(rows.sum())
            total += -2 * multivariate_normal(h[i][rows] @ offset[i], covariance).logpdf(z[i][rows])
            total -= rows.sum() * np.log(2 * np.pi)
        return total

    for scatter in (Scatter(0.03, SCATTER), Scatter(0.1, 9 * SCATTER), Scatter(0.01, 0.1 * SCATTER)):
        marginal = own.evaluate(fit.point, [], scatter)
        assert marginal.squares.sum() + marginal.log_volume.sum() == pytest.approx(dense(scatter), abs=1e-4)


def test_scores_are_the_slope_of_the_likelihood(fitter):
    """By central differences, launches that follow an effect included."""
    fit = fitter.fit(fitter.start(), effects=["tilt"])
    away = {"tilt": {name: value + 0.004 for name, value in fit.point.effects["tilt"].items()}}
    fit = replace(fit, point=replace(fit.point, effects=away))
    launches = KnownLaunch(len(fit.point.latents))
    object.__setattr__(launches, "means", fit.point.latents[:, :5] + [0.002, -0.001, 0.03, -0.02, 0.2])
    own = fitter.about(launches)
    columns = own.columns(["tilt"])
    scatter = Scatter(0.03, SCATTER)
    for _ in range(3):
        latents = fit.point.latents + own.evaluate(fit.point, [], scatter).step
        fit = replace(fit, point=replace(fit.point, latents=latents))
    at = own.evaluate(fit.point, columns, scatter)
    c = [column.parameter for column in columns].index("slope_y")
    step = 1e-4
    sides = []
    for sign in (1, -1):
        values = dict(fit.point.effects["tilt"])
        values["slope_y"] += sign * step
        there = own.evaluate(Point(fit.point.latents, fit.point.nuisance, {"tilt": values}), [], scatter)
        sides.append(float(there.squares.sum()))
    assert -at.scores[:, c].sum() == pytest.approx((sides[0] - sides[1]) / (4 * step), rel=0.02)


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_what_tracks_say_of_an_effect_does_not_depend_on_where_launches_should_be(fitter, slope):
    """Launches are expected as a slope would turn them: they ask for one, tracks only where there is one."""
    tracks = hit_tracks(recording(np.random.default_rng(5), 40, {"tilt": {"slope_x": 0.0, "slope_y": slope}}))
    hits = HitFitter(SlideModel(tracks, fitter.effects, RADIUS, CAMERA), CameraNoise(0.003, 0.0))
    plain = hits.fit(hits.start(), effects=["tilt"] if slope else [])
    launches = KnownLaunch(len(plain.point.latents))
    object.__setattr__(launches, "means", plain.point.latents[:, :5] - [0, 0, 0, GRAVITY * (0.02 - slope), 0])
    told = hits.about(launches)
    with_tilt, without = (told.fit(plain.point, Scatter(0.03, SCATTER), names) for names in (["tilt"], []))
    assert without.objective - with_tilt.objective > 20
    if slope:
        # As without a word on launches: two fits from scratch.
        few, both = (hits.fit(hits.start(), effects=names) for names in ([], ["tilt"]))
        expected = (few.objective - both.objective) / 2
        assert expected > 20
        assert told.gain_by_tracks(with_tilt, "tilt") == pytest.approx(expected, rel=0.1)
    else:
        # Two parameters gain a nat by chance.
        assert abs(told.gain_by_tracks(with_tilt, "tilt")) < 5


def test_tracks_alone_do_not_tell_how_large_a_camera_shows_places(fitter):
    """Launches and friction scaled with the places give the same frames: a likelihood is the same, too."""
    tracks, size = fitter.model.tracks, 0.1
    hits = HitFitter(
        SlideModel(tracks, {"camera_scale": catalogue()["camera_scale"]}, RADIUS, CAMERA), fitter.noise
    )
    latents = fitter.fit(fitter.start()).point.latents.copy()
    latents[:, 4] = 0.0  # what spins has a radius that no camera scales
    nuisance = np.log([[0.35, 0.35, 0.005]])
    shrunk = latents.copy()
    shrunk[:, :2] = CAMERA + (latents[:, :2] - CAMERA) * np.exp(-size)
    shrunk[:, 2:4] *= np.exp(-size)
    values = {"log_scale": size, "shift_x": 0.0, "shift_y": 0.0}
    points = [
        Point(latents, nuisance),
        Point(shrunk, nuisance - size * np.array([1, 1, 0]), {"camera_scale": values}),
    ]
    plain, scaled = (hits.evaluate(point, [], Scatter(0.03, np.zeros((0, 0)))) for point in points)
    np.testing.assert_allclose(scaled.squares, plain.squares, rtol=1e-3)
    # Were the prior flat in metres, 4 numbers a launch would make it 8 size = 0.8 a hit.
    np.testing.assert_allclose(scaled.log_volume, plain.log_volume, atol=0.01)


def test_a_late_camera_shows_the_faster_motion_before_the_release(fitter):
    """x(t - d) = v (t - d) - mu g (t - d)^2 / 2 for a disc without spin, before the release as after it."""
    effect = catalogue()["camera_time"]
    tracks = fitter.model.tracks.take(np.arange(1))
    model = SlideModel(tracks, {"camera_time": effect}, RADIUS, CAMERA)
    mu, v, delay = 0.35, 2.0, 0.06
    latents = np.array([[0.6, 0.0, v, 0.0, 0.0, 0.0]])
    point = Point(latents, np.log([[mu, mu, 0.005]]), {"camera_time": {"delay": delay}})
    moments = tracks.times[0][tracks.valid[0]] - delay
    moments = moments[moments < 0.2]
    expected = 0.6 + v * moments - mu * GRAVITY * moments**2 / 2
    assert (moments < 0).sum() >= 2
    np.testing.assert_allclose(model.predict(point)[0, : len(moments), 0], expected, atol=1e-4)


class Sticky(Effect):
    """Another friction by another name, and a force besides."""

    name, phase, follows, physics, source = "sticky", "slide", "place", "", ""
    parameters = (
        Parameter("more", "1", -1.0, 1.0, 0.1, "log of a factor on friction"),
        Parameter("wind", "m/s^2", -1.0, 1.0, 0.1, "towards +y"),
    )

    def log_friction(self, values, state):
        return values["more"]

    def accelerate(self, values, state):
        return np.zeros_like(state.x), values["wind"]


def test_an_effect_is_as_large_as_it_does_what_no_other_friction_does():
    tracks = hit_tracks(recording(np.random.default_rng(5), 30, spin_sd=0.5))
    fitter = HitFitter(SlideModel(tracks, {"sticky": Sticky()}, RADIUS, CAMERA), CameraNoise(0.003, 0.0))
    fit = fitter.fit(fitter.start(), effects=["sticky"])

    def shift(more, wind):
        at = replace(fit, point=replace(fit.point, effects={"sticky": {"more": more, "wind": wind}}))
        return fitter.shift(at, "sticky"), np.sqrt(
            (fitter._moved_by(at, "sticky") ** 2).sum(-1).mean(0).max()
        )

    beyond, absolute = shift(0.1, 0.0)
    assert absolute > 0.01
    assert beyond < 0.2 * absolute  # what is left is curvature: a tenth of friction is no small change
    beyond, absolute = shift(0.0, 0.2)
    assert beyond > 0.8 * absolute


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("camera_scale", {"log_scale": -0.09, "shift_x": 0.02}),
        ("camera_rotation", {"angle": 0.2, "shift_y": -0.03}),
        ("lens_distortion", {"radial": 0.05, "middle_x": 0.3}),
    ],
)
def test_where_an_object_really_lay_the_camera_sees_it_where_it_was_seen(name, values):
    effect = catalogue()[name]
    given = {**effect.neutral(), **values}
    seen = np.array([[0.55, 0.0], [0.6, -0.04]])
    real = seen + start_shift(effect, given, seen, CAMERA)
    each = {key: np.full(len(seen), value) for key, value in given.items()}
    np.testing.assert_allclose(effect.see(each, real[:, None], CAMERA)[:, 0], seen, atol=1e-6)


def test_encoders_add_as_many_expected_squares_as_they_have_readings():
    """Whitening writes what lies within the basis twice: rows are more than squares."""
    rng = np.random.default_rng(6)
    hits, moments, joints, sd = 400, 20, 2, 1e-3
    times = np.linspace(0.03, 0.6, moments)
    speeds = np.sin(3 * times[:, None] + rng.uniform(0, 6, (hits, 1, joints)))
    noise = rng.normal(0, sd, (hits, moments, joints))
    basis = Execution(times, noise, speeds).basis
    residual = noise + np.einsum("nmjc,nc->nmj", basis, rng.normal(0, 0.01, (hits, basis.shape[-1])))
    encoders = Encoders(execution := Execution(times, residual, speeds), execution.whiten(residual), {})
    squares = (encoders.white**2).sum(1).mean()
    assert encoders.readings == moments * joints < encoders.white.shape[1]
    # Of n hits the mean of chi-squared with k degrees of freedom scatters by sqrt(2 k / n).
    assert squares == pytest.approx(encoders.readings, abs=4 * np.sqrt(2 * encoders.readings / hits))


def test_encoders_gain_by_an_effect_what_it_takes_off_their_squares(fitter):
    fit = fitter.fit(fitter.start(), effects=["tilt"])
    assert fitter.gain_by_encoders(fit, "tilt") == 0.0
    left = {(): 10.0, ("tilt",): 4.0}

    class Read(UnknownLaunch):
        def encoder_rows(self, columns, point):
            return np.full((self.count, 3), left[tuple(point.effects)]), np.zeros(
                (self.count, 3, len(columns))
            )

    read = fitter.about(Read(len(fit.point.latents)))
    assert read.gain_by_encoders(fit, "tilt") == len(fit.point.latents) * 3 * (10.0**2 - 4.0**2) / 2


def test_a_launch_is_told_at_another_moment_as_friction_would_have_it():
    launches = np.array([[1.0, 0.0, 0.0, 2.0, 3.0], [0.5, 0.0, 0.0, 0.0, 0.0]])
    later = _told_at(launches, np.array([0.1, 0.1]), np.array([4.0, 4.0]))
    np.testing.assert_allclose(later[0], [1.0, 0.2 - 0.02, 0.0, 1.6, 3.0])
    np.testing.assert_allclose(later[1], launches[1])  # lies still
    there_and_back = _told_at(later, np.array([-0.1, 0.0]), np.array([4.0, 4.0]))
    np.testing.assert_allclose(there_and_back, launches)


def some_scores(rng, delay, hits=100):
    """Scores of a delay (in s), of drag and of two bumps of friction by speed, all seen clearly."""
    columns = [
        Column("command_delay", "delay", -1, 1e-3),
        Column("linear_drag", "rate", -1, 1e-2),
        Column("free_speed", "along_0", -1, 1e-2),
        Column("free_speed", "along_1", -1, 1e-2),
    ]
    prior_sd = np.array([0.03, 0.3, 0.3, 0.3])
    design = rng.normal(size=(hits, 20, 4)) / np.array([1e-4, 0.1, 0.1, 0.1]) / np.sqrt(hits)
    e = rng.normal(size=(hits, 20)) + design[..., 0] * delay
    z = design * prior_sd
    b, information = np.einsum("nrp,nr->np", z, e), z.transpose(0, 2, 1) @ z
    return columns, Scores(b, information, prior_sd, np.zeros(4, bool))


def test_a_delay_of_less_than_a_time_step_is_an_error_of_the_simulation():
    groups = [np.array([0]), np.array([1]), np.array([2, 3])]
    found = {}
    for delay in (TIMESTEP, 20 * TIMESTEP):
        columns, of = some_scores(np.random.default_rng(1), delay)
        known = with_law_errors(of, columns, ["linear_drag"], np.log(0.3), 1.5)
        found[delay] = mismatch_test(known, groups, np.random.default_rng(2), 199).p_value
        assert mismatch_test(of, groups, np.random.default_rng(2), 199).p_value < 0.02
    assert found[TIMESTEP] > 0.05
    assert found[20 * TIMESTEP] < 0.02


def test_what_a_catalogued_law_describes_is_no_error_of_friction():
    columns, of = some_scores(np.random.default_rng(3), 0.0)
    known = with_law_errors(of, columns, ["linear_drag"], np.log(0.3), 1.5)
    before, after = Elimination(of), Elimination(known)
    assert after.information[1, 1] == pytest.approx(before.information[1, 1], rel=1e-4)
    # A bump of free form is as large by an error of the law as by a push.
    assert after.information[2, 2] < 0.5 * before.information[2, 2]


def test_directions_that_only_incredible_values_would_show_are_not_tested():
    """A thousandth of the prior's information: even a score of ten sd means 300 times what is believed."""
    rng = np.random.default_rng(4)
    design = rng.normal(size=(50, 20, 2)) * np.array([1.0, 1e-3])
    e = rng.normal(size=(50, 20)) + 1e4 * design[..., 1]
    of = Scores(
        np.einsum("nrp,nr->np", design, e), design.transpose(0, 2, 1) @ design, np.ones(2), np.zeros(2, bool)
    )
    found = Elimination(of)(of.b)
    assert group_statistics(found, [np.array([1])])[0] > 20
    assert group_statistics(found, [np.array([1])], least=1.0)[0] == 0


def test_readings_add_what_they_tell_of_the_columns_that_they_see():
    """As one regression on tracks and readings, of columns of which readings see two."""
    rng = np.random.default_rng(6)
    design, readings = rng.normal(size=(3, 8, 4)), rng.normal(size=(3, 5, 4))
    readings[..., [0, 2]] = 0.0
    e, residual = rng.normal(size=(3, 8)), rng.normal(size=(3, 5))
    none = np.empty((3, 0))
    tracks = Marginal(
        design.transpose(0, 2, 1) @ design, np.einsum("nrp,nr->np", design, e), (e**2).sum(1),
        np.zeros(3), none, none[:, :, None], none[:, :, None],
    )  # fmt: skip
    both, left = np.concatenate([design, readings], axis=1), np.concatenate([e, residual], axis=1)
    found = with_readings(tracks, residual, readings)
    np.testing.assert_allclose(found.information, both.transpose(0, 2, 1) @ both)
    np.testing.assert_allclose(found.scores, np.einsum("nrp,nr->np", both, left))
    np.testing.assert_allclose(found.squares, (left**2).sum(1))


def test_a_projection_weighted_value_by_value_is_that_of_weighted_least_squares():
    rng = np.random.default_rng(3)
    basis, values, weights = rng.normal(size=(40, 4)), rng.normal(size=(40, 5)), rng.uniform(0, 1, (40, 5))
    found = weighted_projection(basis, values, weights)
    for k in range(5):
        root = np.sqrt(weights[:, k])
        best, *_ = np.linalg.lstsq(root[:, None] * basis, root * values[:, k], rcond=None)
        np.testing.assert_allclose(found[:, k], basis @ best, atol=1e-10)
    assert (weighted_projection(basis[:, :0], values, weights) == 0).all()


def test_launches_that_slides_hardly_tell_leave_the_scatter_of_others_alone():
    """Of 200 launches a twentieth is known to a hundred times what launches scatter by."""
    rng, count, sd = np.random.default_rng(4), 200, np.array([0.002, 0.003, 0.03, 0.02])
    untold = np.ones((count, 1))
    untold[::20] = 1e3
    model = LaunchModel.__new__(LaunchModel)
    model._turn, model.spread = np.tile(np.eye(5), (count, 1, 1)), np.zeros((count, 5, 5))
    model._smooth = np.linalg.qr(rng.normal(size=(count, 6)))[0]
    model.means = lambda point: np.zeros((count, 5))
    variance = np.zeros((count, 5))
    variance[:, :4], variance[:, 4] = 0.01 * untold**2 * sd**2, 1.0
    measured = np.sqrt(variance) * rng.normal(size=(count, 5))
    measured[:, :4] += sd * rng.normal(size=(count, 4))
    noise = np.einsum("ni,ij->nij", variance, np.eye(5))
    scatter = model.first_scatter
    for _ in range(20):
        scatter = model.scatter(None, measured, noise, scatter)
    # The standard error of a standard deviation is 1 / sqrt(2 n); tails weigh less.
    np.testing.assert_allclose(np.sqrt(np.diag(scatter)[:4]), sd, rtol=4 / np.sqrt(2 * count) + 0.05)
