"""Noise, marginal likelihood, evidence and execution, each against the slow way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from slapshot.diagnosis.inference.mismatch_test import Elimination, Scores, group_statistics
from slapshot.diagnosis.pucks.fit.marginal import marginalise
from slapshot.diagnosis.pucks.held_out import HeldOut, errors_of
from slapshot.diagnosis.pucks.launch.execution import Execution, replay
from slapshot.diagnosis.pucks.launch.launch_model import TAILS, tail_weight, weight_cost
from slapshot.diagnosis.pucks.selection.evidence import SIZES, LinearEvidence, project
from slapshot.diagnosis.pucks.selection.search import TESTED, Search, balanced, with_few_directions
from slapshot.diagnosis.pucks.slide.noise import CameraNoise, estimate_noise, outliers, timing_jitter
from slapshot.diagnosis.pucks.slide.slide_model import Column
from slapshot.effects.catalogue import catalogue


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def covariance_of(noise, times, sd):
    gap = np.abs(times[:, None] - times)
    coloured = noise.coloured * noise.sd**2 * np.exp(-gap / noise.time) if noise.time else 0.0
    white = sd**2 - (noise.coloured * noise.sd**2 if noise.time else 0.0)
    return coloured + np.diag(white)


@pytest.mark.parametrize(
    "noise",
    [
        CameraNoise(0.003, 0.0),
        CameraNoise(0.003, 0.03),
        CameraNoise(0.003, 0.03, coloured=0.4),
        CameraNoise(0.003, 0.03, jitter=0.001, coloured=0.4),
    ],
)
def test_whitened_scalar_products_are_those_of_the_covariance(rng, noise):
    times = np.cumsum(rng.uniform(0.02, 0.06, 12))
    x, y = rng.normal(size=(2, 12))
    sd = noise.sd_at(rng.uniform(0, 3, 12))
    white = noise.whiten(np.stack([x, y], -1)[None], times[None], np.ones((1, 12), bool), sd[None])[0]
    expected = x @ np.linalg.solve(covariance_of(noise, times, sd), y)
    assert white[:, 0] @ white[:, 1] == pytest.approx(expected, rel=1e-10)


def test_white_and_coloured_noise_are_told_apart(rng):
    """400 stretches of 25 frames at 50 Hz, 3 mm white and 2 mm with a memory of 40 ms: what is whitened is.

    Sums of its squares differ from their expectation by sqrt(2 / 19,200) or 1 %, and by twice that for each
    of the parameters; of neighbours, products by 1 / sqrt(19,200) or .7 %.
    """
    stretches, frames, rate = 400, 25, 50
    memory = np.exp(-1 / (rate * 0.04))
    process = rng.normal(0, 0.002, (stretches, frames, 2))
    for k in range(1, frames):
        process[:, k] = memory * process[:, k - 1] + np.sqrt(1 - memory**2) * process[:, k]
    seen = process + rng.normal(0, 0.003, process.shape)
    intervals = np.full((stretches, frames), 1 / rate)
    intervals[:, 0] = np.inf
    noise = estimate_noise((seen - seen.mean(1, keepdims=True)).reshape(-1, 2), intervals.ravel())
    assert noise.sd == pytest.approx(np.hypot(0.003, 0.002), rel=0.03)
    assert noise.coloured == pytest.approx(4 / 13, abs=0.08)
    times = np.tile(np.arange(frames) / rate, (stretches, 1))
    white = noise.whiten(seen, times, np.ones((stretches, frames), bool), np.full(times.shape, noise.sd))
    assert (white**2).mean() == pytest.approx(1, abs=0.04)
    for lag in (1, 2, 3):
        assert abs((white[:, lag:] * white[:, :-lag]).mean()) < 0.03


def test_the_stated_error_of_the_noise_is_that_by_which_estimates_scatter(rng):
    """100 estimates from 400 frames: their sd is told within 28 %, four standard errors of an sd."""
    intervals = np.full(400, 0.02)
    intervals[::20] = np.inf
    found = [estimate_noise(rng.normal(0, 0.003, (400, 2)), intervals) for _ in range(100)]
    variances = np.array([noise.sd**2 for noise in found])
    stated = np.mean([noise.error for noise in found])
    assert variances.std() / variances.mean() == pytest.approx(stated, rel=0.28)


@pytest.mark.parametrize("ratio", [1, 3, 10])
def test_noise_that_is_larger_along_one_axis_is_not_taken_for_mistracks(rng, ratio):
    """A variance of 4000 values has a standard error of sqrt(2 / 4000); so has the mean if one dominates."""
    residuals = rng.normal(0, 1, (4000, 2)) * (0.001 * ratio, 0.001)
    intervals = np.full(4000, 0.02)
    intervals[::20] = np.inf
    noise = estimate_noise(residuals, intervals)
    assert noise.sd**2 == pytest.approx(0.001**2 * (1 + ratio**2) / 2, rel=4 * np.sqrt(2 / 4000))


@pytest.mark.parametrize("time", [0.0, 0.02])
def test_noise_is_estimated_in_spite_of_mistracks(rng, time):
    """20,000 frames at 50 Hz, 1 % of them anywhere: sd within 2 %, memory within 15 %."""
    n, rate = 20_000, 50
    memory = np.exp(-1 / (rate * time)) if time else 0.0
    white = rng.normal(size=(n, 2))
    e = white.copy()
    for k in range(1, n):
        e[k] = memory * e[k - 1] + np.sqrt(1 - memory**2) * white[k]
    residuals = 0.003 * e
    wrong = rng.uniform(size=n) < 0.01
    residuals[wrong] += rng.uniform(-0.2, 0.2, (wrong.sum(), 2))
    intervals = np.full(n, 1 / rate)
    intervals[0] = np.inf
    noise = estimate_noise(residuals, intervals)
    assert noise.sd == pytest.approx(0.003, rel=0.02)
    assert noise.time == (pytest.approx(time, rel=0.15) if time else 0.0)


@pytest.mark.parametrize("jitter", [0.0, 0.002])
@pytest.mark.parametrize("wrong", ["frames", "stamps"])
def test_frames_taken_at_the_wrong_time_are_noisier_where_objects_are_fast(rng, jitter, wrong):
    """100 slides that brake from 2 m/s, seen at 100 Hz with 0.3 mm of noise: within 15 %."""
    times = np.tile(np.arange(0, 1, 0.01), (100, 1))
    error = rng.normal(0, jitter, times.shape)
    when, times = (times + error, times) if wrong == "frames" else (times, times + error)
    along = 2 * when - when**2
    places = np.stack([along, 0 * along], -1) + rng.normal(0, 3e-4, (100, 100, 2))
    found = timing_jitter(times, places, np.ones((100, 100), bool))
    assert found == (pytest.approx(jitter, rel=0.15) if jitter else 0.0)


def test_a_jump_is_an_outlier_and_a_bend_is_none():
    t = np.linspace(0, 1, 30)
    residuals = np.stack([0.05 * t**2, np.zeros(30)], -1)[None]
    valid, sd = np.ones((1, 30), bool), np.full((1, 30), 0.003)
    assert not outliers(residuals, valid, sd).any()
    residuals[0, 11] += (0.03, 0.0)
    np.testing.assert_array_equal(np.flatnonzero(outliers(residuals, valid, sd)[0]), [11])


def test_frames_whose_stamps_jitter_are_no_outliers(rng):
    """At 2 m/s a jitter of 1 ms is 2 mm, seven times the noise at rest."""
    valid, sd = np.ones((50, 40), bool), np.full((50, 40), 3e-4)
    residuals = rng.normal(0, 2e-3, (50, 40, 2))
    assert outliers(residuals, valid, sd).mean() > 0.2
    assert outliers(residuals, valid, np.hypot(sd, 2e-3)).mean() < 1e-3


def test_the_marginal_is_that_of_the_joint_gaussian(rng):
    """-2 log p(y | t) with the latents integrated out, by the covariance of y."""
    m, u, p = 9, 3, 2
    h, j, drift = rng.normal(size=(m, u)), rng.normal(size=(m, p)), rng.normal(size=(u, p))
    root = np.diag([0.7, 1.3, 2.0])
    mean, latents = rng.normal(size=(2, u))
    z = rng.normal(size=m)
    out = marginalise(z[None], h[None], j[None], (mean - latents)[None], root, drift[None])
    covariance = np.eye(m) + h @ np.linalg.inv(root.T @ root) @ h.T

    def exact(d):
        # z is y - f(latents, 0): what remains at the prior's mean, which moves with d, and parameters d.
        left = z - h @ (mean + drift @ d - latents) - j @ d
        return left @ np.linalg.solve(covariance, left)

    def ours(d):
        return out.squares[0] - 2 * out.scores[0] @ d + d @ out.information[0] @ d

    for d in (np.zeros(p), rng.normal(size=p)):
        assert ours(d) == pytest.approx(exact(d), rel=1e-9)
    volume = np.linalg.slogdet(covariance)[1] + 2 * np.linalg.slogdet(root)[1]
    assert out.log_volume[0] == pytest.approx(volume)


def test_a_flat_prior_gives_least_squares(rng):
    h, z = rng.normal(size=(8, 3)), rng.normal(size=8)
    none = np.zeros((1, 3, 0))
    out = marginalise(z[None], h[None], np.zeros((1, 8, 0)), np.zeros((1, 3)), np.zeros((3, 3)), none)
    best, squares, *_ = np.linalg.lstsq(h, z, rcond=None)
    np.testing.assert_allclose(out.step[0], best)
    assert out.squares[0] == pytest.approx(squares[0])


def test_evidence_is_the_ratio_of_marginal_likelihoods(rng):
    """Linear model with known noise: the prior's covariance is added to the noise's, or not."""
    j, scales = rng.normal(size=(30, 3)), np.array([0.5, 1.0, 2.0])
    y = j @ (scales * rng.normal(size=3)) + rng.normal(size=30)
    ours = LinearEvidence(j.T @ j, scales).log_ratio((j.T @ y)[None])[0]
    without = multivariate_normal(np.zeros(30), np.eye(30)).logpdf(y)
    each = [
        multivariate_normal(np.zeros(30), np.eye(30) + s**2 * (j * scales**2) @ j.T).logpdf(y) - without
        for s in SIZES
    ]
    assert ours == pytest.approx(np.logaddexp.reduce(each) - np.log(len(SIZES)))


def test_the_estimate_is_the_posterior_mean(rng):
    j, scales = rng.normal(size=(30, 2)), np.array([0.5, 2.0])
    y = rng.normal(size=30)
    judge = LinearEvidence(j.T @ j, scales)
    expected = np.linalg.solve(j.T @ j + np.diag((3 * scales) ** -2.0), j.T @ y)
    np.testing.assert_allclose(judge.estimate((j.T @ y)[None])[0], expected)


def test_a_parameter_that_cannot_be_negative_has_no_evidence_there():
    judge = LinearEvidence(np.eye(1), np.ones(1), one_sided=True)
    assert judge.log_ratio(np.array([[5.0]]))[0] > 3
    assert judge.log_ratio(np.array([[-5.0]]))[0] < 0


def test_projecting_out_is_fitting_along(rng):
    j = rng.normal(size=(40, 5))
    scores = j * rng.normal(size=40)[:, None]
    fixed = np.array([0, 3])
    out = project(j.T @ j, scores, fixed, np.zeros((2, 2)))
    q, _ = np.linalg.qr(j[:, fixed])
    others = j[:, [1, 2, 4]] - q @ (q.T @ j[:, [1, 2, 4]])
    np.testing.assert_allclose(out.information, others.T @ others, atol=1e-10)


@pytest.fixture
def executed(rng):
    """60 hits of two joints that run at another pace and drift, read with 1 mrad of noise."""
    n, times = 60, np.arange(0, 0.8, 0.01)
    swing = np.stack([np.sin(2 * times), 0.5 * times**2], -1)
    speed = np.gradient(swing, times, axis=0)
    pace, drift = rng.normal(0, 0.02, n), rng.normal(0, 0.01, (n, 2))
    share = times / times[-1]
    residual = -pace[:, None, None] * (times[:, None] * speed) + drift[:, None] * share[:, None] ** 2
    residual = residual + rng.normal(0, 1e-3, residual.shape)
    return times, residual, np.tile(speed, (n, 1, 1)), pace


def test_the_execution_is_told_apart_from_encoder_noise(executed):
    times, residual, speed, pace = executed
    execution = Execution(times, residual, speed)
    assert execution.sd == pytest.approx(1e-3, rel=0.05)
    coefficients, covariance = execution.coefficients(residual)
    error = coefficients[:, 0] - pace
    assert np.sqrt((error**2).mean()) < 1.3 * np.sqrt(covariance[:, 0, 0].mean())
    assert np.corrcoef(coefficients[:, 0], pace)[0, 1] > 0.9


def test_a_late_swing_is_no_encoder_noise(executed):
    times, residual, speed, _ = executed
    late = residual - 0.03 * speed * (times > 0.1)[:, None]
    assert Execution(times, late, speed).sd == pytest.approx(1e-3, rel=0.1)


def test_whitened_readings_have_the_products_of_their_covariance(executed):
    times, residual, speed, _ = executed
    execution = Execution(times, residual, speed)
    white = execution.whiten(residual)[0]
    basis = execution.basis[0].reshape(-1, execution.basis.shape[-1])
    covariance = execution.sd**2 * np.eye(len(basis)) + basis @ execution.covariance @ basis.T
    x = residual[0].ravel()
    assert white @ white == pytest.approx(x @ np.linalg.solve(covariance, x), rel=1e-6)


def test_a_replayed_motion_runs_at_its_pace():
    positions = np.sin(np.arange(0, 1, 0.001))[None, :, None]
    coefficients = np.array([[0.05, 0.0, 0.02, 0.0]])
    out = replay(positions, 0.001, 0.999, coefficients)
    t = np.arange(0, 1, 0.001)
    expected = np.sin(0.95 * t) + 0.02 * (t / 0.999) ** 2
    np.testing.assert_allclose(out[0, :, 0], expected, atol=1e-6)


def test_what_is_not_known_of_the_noise_widens_the_interval_of_chi_squared(rng):
    """Chi-squared that is 1.2 in all hits has no other error: 99 % lie within 2.576 standard errors."""
    n = 50
    held = HeldOut(*(np.ones(n) for _ in range(4)), None, None, np.zeros(n), np.zeros(n), np.full(n, 1.2))
    sure, unsure = (errors_of(held, np.zeros(n), rng, error).chi2_per_freedom for error in (0.0, 0.05))
    assert (sure.low, sure.high) == pytest.approx((1.2, 1.2))
    assert (unsure.low, unsure.high) == pytest.approx(
        (1.2 - 1.2 * 0.05 * 2.576, 1.2 + 1.2 * 0.05 * 2.576), rel=1e-4
    )


@pytest.mark.parametrize(
    ("camera", "encoders", "told"), [(1.2, 1.01, 1.2), (0.99, 1.4, 1.4), (1.0, 0.9, 1.0)]
)
def test_chi_squared_is_that_of_what_is_explained_worst(rng, camera, encoders, told):
    """Of camera and encoders, however many numbers there are of either."""
    n = 50
    held = HeldOut(*(np.ones(n) for _ in range(4)), None, None, np.zeros(n), np.zeros(n), np.full(n, camera))
    held = replace(held, encoder_chi2=np.full(n, encoders))
    assert errors_of(held, np.zeros(n), rng).chi2_per_freedom.value == pytest.approx(told)


@pytest.mark.parametrize("size", [2, 5])
def test_weighted_squares_grow_like_the_density_of_a_t_beyond_what_is_usual(size):
    """By itself up to `size`; beyond as -2 log density of a t does, with the weight as its slope."""
    distance = np.linspace(0.01, 200, 4000)
    weight = tail_weight(distance, size)
    told = weight * distance + weight_cost(weight, size)
    usual = distance <= size
    np.testing.assert_allclose(told[usual], distance[usual])
    density = (TAILS + size) * np.log1p(distance / TAILS)
    np.testing.assert_allclose(np.diff(told[~usual]), np.diff(density[~usual]), rtol=1e-9)
    slope = np.gradient(told, distance)
    np.testing.assert_allclose(slope[1:-1], weight[1:-1], atol=2e-3)
    # It is least at these weights.
    for off in (0.9, 1.05):
        other = np.minimum(off * weight, 1.0)
        assert np.all(other * distance + weight_cost(other, size) >= told - 1e-9)


def test_beside_a_field_that_a_prior_holds_down_a_screen_is_that_of_a_fit_of_both(rng):
    """Against dense ridge regression: 40 bumps with a tight prior, and one effect without any."""
    bumps, effect = rng.normal(size=(200, 40)), rng.normal(size=(200, 1))
    effect += bumps[:, :1]
    readings = bumps @ rng.normal(size=40) + 0.8 * effect[:, 0] + rng.normal(size=200)
    precision = np.full(40, 300.0)
    alone = np.linalg.solve(bumps.T @ bumps + np.diag(precision), bumps.T @ readings)
    left = readings - bumps @ alone
    by = np.hstack([bumps, effect])
    scores = by * left[:, None]
    fitted = np.arange(40)
    projected = project(by.T @ by, balanced(scores, fitted), fitted, np.diag(precision))
    both = np.linalg.solve(by.T @ by + np.diag([*precision, 0.0]), by.T @ readings)
    estimate = projected.scores.sum(0) / projected.information[0]
    np.testing.assert_allclose(estimate, both[40:], rtol=1e-9)
    unbalanced = project(by.T @ by, scores, fitted, np.diag(precision))
    assert abs(unbalanced.scores.sum() - projected.scores.sum()) > 0.1 * abs(projected.scores.sum())


def test_directions_that_are_not_tested_change_no_statistic(rng):
    """Two fields of 12 columns, half of whose directions are hardly told; nuisance is told by other rows."""
    hits, rows = 40, 30
    z = np.zeros((hits, rows, 27))
    z[:, :3, :3] = rng.normal(size=(hits, 3, 3))
    for first in (3, 15):
        told, hardly = (rng.normal(size=(6, 12)) for _ in range(2))
        z[:, 3:, first : first + 12] = rng.normal(size=(hits, rows - 3, 6)) @ told
        z[:, 3:, first : first + 12] += 1e-3 * rng.normal(size=(hits, rows - 3, 6)) @ hardly
    e = rng.normal(size=(hits, rows)) + z[:, :, 5]
    nuisance = np.arange(27) < 3
    of = Scores(np.einsum("hrp,hr->hp", z, e), z.transpose(0, 2, 1) @ z, np.ones(27), nuisance)
    groups = [np.arange(3, 15), np.arange(15, 27)]
    few, found = with_few_directions(of, groups)
    assert few.b.shape == (hits, 15)
    assert [len(group) for group in found] == [6, 6]
    expected = group_statistics(Elimination(of)(of.b), [group - 3 for group in groups], TESTED)
    np.testing.assert_allclose(group_statistics(Elimination(few)(few.b), found, TESTED), expected, rtol=1e-3)
    assert expected[0] > 10


def test_where_nothing_can_be_told_nothing_contradicts_the_nominal_scene(rng):
    columns = [Column("red", "log_mu_x", 0, 0.01), Column("tilt", "slope_x", -1, 0.01)]
    point = SimpleNamespace(nuisance=np.zeros((1, 3)), latents=np.zeros((6, 6)))
    fitter = SimpleNamespace(effects=catalogue(), prior=lambda columns: (np.zeros(2), np.ones(2)))
    search = Search(fitter, ["tilt"], [], rng)
    at = SimpleNamespace(fit=SimpleNamespace(point=point))
    hardly = SimpleNamespace(scores=np.zeros((6, 2)), information=np.tile(1e-4 * np.eye(2), (6, 1, 1)))
    assert search._p_value(at, columns, hardly, ["tilt"]) == 1.0
