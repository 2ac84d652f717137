"""Noise that is fitted against the noise that was put in; intervals come from the likelihood's curvature."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.noise import (
    DRIFT,
    FORCE_HOLD_S,
    NOMINAL,
    Noise,
    NoiseLikelihood,
    Prior,
    fit_noise,
    fit_process_force,
    initial_noise,
    log_likelihood,
    marginal_likelihood,
    posterior_means,
    prefers_jitter,
)
from slapshot.diagnosis.inference.fisher_scoring import Evaluation, derivatives
from slapshot.diagnosis.model.segments import Segments

INTERVAL, TORQUE, INERTIA = 0.01, 2.0, 0.5
KINDS = ("position", "velocity")


@dataclass(frozen=True)
class Made:
    """Data of an oscillator about a trajectory at rest, and the noise that is in them."""

    system: Linear
    segments: Segments
    noise: Noise


def made(
    seed: int,
    *,
    S: int = 16,
    L: int = 60,
    white: tuple[float, float] = (1e-3, 2e-2),
    coloured: tuple[float, float] = (0.0, 0.0),
    correlation_s: float = 0.08,
    force: float = 1e-6,
    columns: int = 0,
    law_error: float = 1e-4,
) -> Made:
    """Draw from the filter's own equations, one random number at a time."""
    rng, channels = np.random.default_rng(seed), len(KINDS)
    omega, damping = 6.0, 0.3
    rotate = np.array([[0.0, 1.0], [-(omega**2), -damping]])
    A = np.eye(2) + INTERVAL * rotate + INTERVAL**2 / 2 * rotate @ rotate
    B = np.array([[INTERVAL**2 / 2], [INTERVAL]]) / INERTIA
    held = force * TORQUE * np.sqrt(FORCE_HOLD_S / INTERVAL)
    decay = np.exp(-INTERVAL / correlation_s)
    # Laws that would push with the torque's size: smooth random functions of time.
    t = np.arange(S * L) * INTERVAL
    shapes = [np.sin((3 + 1.7 * k) * t + k).reshape(S, L) for k in range(columns)]
    W = (
        np.stack([TORQUE * shape[..., None] * B[:, 0] for shape in shapes], -1)
        if columns
        else np.zeros((S, L, 2, 0))
    )
    share = law_error * rng.standard_normal(columns)
    x = rng.normal(size=(S, 2)) * [0.1, 0.5]
    ou = rng.normal(size=(S, channels)) * coloured
    y = np.empty((S, L, channels))
    for n in range(L):
        y[:, n] = x + ou + rng.normal(size=(S, channels)) * white
        x = x @ A.T + held * rng.standard_normal((S, 1)) @ B.T + W[:, n] @ share
        ou = decay * ou + rng.normal(size=(S, channels)) * coloured * np.sqrt(1 - decay**2)
    shape = (S, L)
    system = Linear(
        np.broadcast_to(A, (*shape, 2, 2)), np.broadcast_to(B, (*shape, 2, 1)), np.zeros((*shape, 2)),
        np.broadcast_to(np.eye(2), (*shape, 2, 2)), y, W, np.zeros((*shape, channels, columns)),
    )  # fmt: skip
    segments = Segments(
        interval=INTERVAL, substeps=1, y=y, shift=np.zeros_like(y), shift_square=np.zeros_like(y),
        inside=np.ones(shape, bool),
        time=np.broadcast_to(np.arange(L) * INTERVAL, shape), episode=np.arange(S), first=np.zeros(S, int),
        order=np.linspace(-0.5, 0.5, S), controls=(np.zeros((L, 0)),) * S, ids=np.arange(S),
        quantisation=np.zeros(channels),
    )  # fmt: skip
    noise = Noise(
        white=np.array(white), coloured=np.array(coloured), correlation_s=np.full(channels, correlation_s),
        force=force, torque=np.array([TORQUE]), initial=np.array([1.0, 25.0]), weight=np.ones_like(y),
        law_error=law_error,
    )  # fmt: skip
    return Made(system, segments, noise)


def fitted(of: Made, prior: Prior | None = None) -> Noise:
    initial_point = initial_noise(of.segments, np.array([TORQUE]), 2, np.array([1.0]), np.array([5.0]))
    return fit_noise(of.system, prior or no_columns(), initial_point, of.segments, KINDS)


def no_columns() -> Prior:
    return Prior.of(np.zeros(0))


def standard_errors(of: Made, names: tuple[str, ...]) -> np.ndarray:
    """Of logarithms of some sizes of the noise, from the curvature of the likelihood at the truth.

    A name is an attribute of the noise, of a channel where it ends with a digit.
    """

    def value(z: np.ndarray) -> float:
        noise = of.noise
        for name, change in zip(names, z, strict=True):
            field = name.rstrip("01")
            now = np.array(getattr(noise, field), float)
            if name == field:
                now = now * np.exp(change)
            else:
                now[int(name[-1])] *= np.exp(change)
            noise = replace(noise, **{field: now if now.ndim else float(now)})
        return log_likelihood(innovations(of.system, noise.covariances(INTERVAL)))

    step, p = 0.05, len(names)
    hessian = np.empty((p, p))
    for i in range(p):
        for j in range(p):
            a, b = step * np.eye(p)[i], step * np.eye(p)[j]
            hessian[i, j] = (value(a + b) - value(a - b) - value(b - a) + value(-a - b)) / (4 * step**2)
    return np.sqrt(np.diag(np.linalg.inv(-hessian)))


def off(found, true, error) -> np.ndarray:
    """By how many standard errors a logarithm is off."""
    return np.abs(np.log(np.asarray(found) / np.asarray(true))) / error


def test_white_noise_is_recovered():
    of = made(1)
    found = fitted(of)
    assert np.all(found.coloured == 0)
    # 960 observations a channel, of which each segment's first state takes two.
    errors = standard_errors(of, ("white0", "white1"))
    np.testing.assert_allclose(errors, 1 / np.sqrt(2 * 960), rtol=0.2)
    assert np.all(off(found.white, of.noise.white, errors) < 4)
    # The process force was too small to be seen: a hundredth of the torque would have been.
    assert found.force < 1e-2
    assert (found.weight > 1).mean() < 1e-3  # beyond 4 sd lie 6 in 100,000


@pytest.mark.parametrize("force", [0.02, 0.3])
def test_process_force_is_recovered(force):
    of = made(2, force=force)
    found = fitted(of)
    errors = standard_errors(of, ("force", "white0", "white1"))
    there = [found.force, *found.white]
    assert np.all(off(there, [force, *of.noise.white], errors) < 4)
    assert errors[0] < 0.2


@pytest.mark.parametrize("initial_point", [1e-5, 20.0])
def test_what_a_model_lacks_is_process_force_and_leaves_readings_as_they_were(initial_point):
    """From far below and far above; noise of the readings is not fitted, be it wrong."""
    of = made(5, force=0.3)
    known = replace(of.noise, force=initial_point, white=1.1 * of.noise.white, coloured=0.1 * of.noise.white)
    found = fit_process_force(of.system, no_columns(), known, INTERVAL)
    np.testing.assert_allclose(found.white, known.white, rtol=1e-12)
    np.testing.assert_allclose(found.coloured, known.coloured, rtol=1e-12)
    right = fit_process_force(of.system, no_columns(), replace(of.noise, force=initial_point), INTERVAL)
    (error,) = standard_errors(of, ("force",))
    assert abs(np.log(right.force / 0.3)) < 4 * error
    # Shares of laws that no column tells of stay what they were.
    assert (right.law_error, right.added_error) == pytest.approx((of.noise.law_error, of.noise.added_error))


def test_jitter_is_looked_for_where_errors_follow_the_rate():
    """By white noise alone in one of six cases, beyond one standard deviation."""
    rng, count = np.random.default_rng(5), 2000
    rate = rng.uniform(0.5, 1.5, count)  # the white noise that is fitted takes most of it
    variance = np.full(count, 0.04)
    called = []
    for jitter in (0.0, 0.2):  # of which the score is 9 standard deviations
        sd = np.sqrt(1 + (jitter * rate) ** 2 / variance)
        errors = [sd * rng.standard_normal(count) for _ in range(500)]
        found = [Evaluation(0.0, e / np.sqrt(np.mean(e**2)), np.log(variance)) for e in errors]
        called.append(np.mean([prefers_jitter(one, rate) for one in found]))
    assert called[0] == pytest.approx(0.159, abs=4 * np.sqrt(0.159 * 0.841 / 500))
    assert called[1] == 1


def test_jitter_of_the_sample_times_is_recovered():
    """Samples are taken a little early or late: their noise grows with the speed of what is observed."""
    of, jitter = made(17), 0.3 * INTERVAL
    rng = np.random.default_rng(18)
    fastest = 3.0 * of.noise.white / jitter
    rate = np.sin(rng.uniform(0, 2 * np.pi, of.system.r.shape)) * fastest
    # Both channels have one clock.
    y = of.system.r + jitter * rate * rng.standard_normal((*rate.shape[:2], 1))
    of = Made(
        replace(of.system, r=y), replace(of.segments, y=y), replace(of.noise, jitter_s=jitter, rate=rate)
    )
    initial_point = initial_noise(of.segments, np.array([TORQUE]), 2, np.array([1.0]), np.array([5.0]))
    initial_point = initial_point.elsewhere(rate, of.segments.order, None)
    found = fit_noise(of.system, no_columns(), initial_point, of.segments, KINDS)
    errors = standard_errors(of, ("jitter_s", "white0", "white1"))
    assert np.all(off([found.jitter_s, *found.white], [jitter, *of.noise.white], errors) < 4)
    assert errors[0] < 0.1
    # Without a rate there is no jitter to be seen.
    without = fitted(made(1))
    assert np.all(without.variance == without.usual_variance * without.weight)


def test_coloured_noise_is_recovered():
    of = made(3, S=24, L=100, coloured=(4e-3, 8e-2), correlation_s=0.06)
    found = fitted(of)
    # Both kinds have their own ratio and time.
    names = ("white0", "white1", "coloured0", "coloured1", "correlation_s0", "correlation_s1")
    errors = standard_errors(of, names)
    there = [*found.white, *found.coloured, *found.correlation_s]
    true = [*of.noise.white, *of.noise.coloured, *of.noise.correlation_s]
    assert np.all(errors < 0.3)
    assert np.all(off(there, true, errors) < 4)


@pytest.mark.parametrize(("outliers", "most"), [(0.0, 0.03), (0.01, 0.05)])
def test_coloured_noise_alone_is_recovered_although_some_readings_are_far_off(outliers, most):
    """None of it is white, or next to none: an outlier of white noise would leave it a tenth of the other.

    Jumps from one reading to the next, of sqrt(1 - exp(-2 / 30)) of its size, are what tells white noise: a
    twentieth of the size adds 4 % to their variance, which 2400 readings of a channel tell to 3 %.
    """
    of = made(
        2, S=24, L=100, white=(0.0, 0.0), coloured=(1e-3, 1e-2), correlation_s=30 * INTERVAL, force=0.02
    )
    rng = np.random.default_rng(100)
    off = np.where(rng.uniform(size=of.segments.y.shape) < outliers, 4.0, 0.0)
    y = of.segments.y + off * rng.normal(size=off.shape) * of.noise.coloured
    of = replace(of, system=replace(of.system, r=y), segments=replace(of.segments, y=y))
    found = fitted(of)
    for _ in range(2):  # with outliers that are known by then
        found = fit_noise(of.system, no_columns(), found, of.segments, KINDS, near=True)
    assert np.all(found.white < most * of.noise.coloured)
    # In 24 segments of 100 readings, of which thirty are alike, 24 (1 + 100 / 60) tell a size to 9 %.
    assert found.coloured == pytest.approx(of.noise.coloured, rel=3 * 0.09)


def test_outliers_keep_the_variance_that_they_lack_when_white_noise_changes():
    of = made(0, S=2, L=5, coloured=(3e-3, 0.0))
    weight = np.ones_like(of.noise.weight)
    weight[0, 2] = [10.0, 4.0]
    noise = replace(of.noise, weight=weight, growth=np.array([0.4, 0.0]), order=of.segments.order)
    other = noise.with_white(np.array([1e-5, 0.3]))
    lacks = [one.variance - one.usual_variance for one in (noise, other)]
    assert lacks[1] == pytest.approx(lacks[0], rel=1e-9, abs=1e-15)
    assert other.variance[1, 2, 0] == pytest.approx(1e-10 * np.exp(2 * 0.4 * 0.5))
    # Over that of a usual reading, of which coloured noise is a part.
    assert noise.outlying[0, 2] == pytest.approx([1 + 9 / 10, 4.0])
    assert noise.single_variance[1, 0] == pytest.approx([1e-5 * np.exp(0.4), 4e-4])


def test_channels_of_one_kind_share_the_colour():
    of = made(4, S=24, coloured=(4e-3, 8e-2))
    initial_point = initial_noise(of.segments, np.array([TORQUE]), 2, np.array([1.0]), np.array([5.0]))
    found = fit_noise(of.system, no_columns(), initial_point, of.segments, ("position", "position"))
    assert found.correlation_s[0] == found.correlation_s[1]
    ratio = found.coloured / found.white
    assert ratio[0] == pytest.approx(ratio[1], rel=1e-12)
    assert ratio[0] == pytest.approx(4, rel=0.3)


def test_force_is_told_for_one_length_of_time():
    """A white force over 1/100 s is one over 1/400 s of twice the standard deviation."""
    of = made(5, force=0.1)
    fast, slow = of.noise.covariances(FORCE_HOLD_S / 4), of.noise.covariances(FORCE_HOLD_S)
    np.testing.assert_allclose(slow.force, (0.1 * TORQUE) ** 2)
    np.testing.assert_allclose(fast.force, 4 * slow.force)
    np.testing.assert_allclose(slow.decay, np.exp(-FORCE_HOLD_S / 0.08))
    some = np.array([1, 3])
    assert of.noise.select(some).covariances(INTERVAL).white.shape == (2, 60, 2)


@pytest.mark.parametrize("coloured", [0.0, 4e-3])
def test_outliers_count_for_less_where_segments_begin_too(coloured):
    """Ten times the noise, in white noise and in colour of which next to nothing is white."""
    of = made(14, S=24, L=60, white=(1e-3 if not coloured else 1e-4, 2e-2), coloured=(coloured, 0.0))
    single = np.hypot(of.noise.white[0], coloured)
    y, bad = of.system.r.copy(), [(3, 0), (7, 59), (11, 30), (15, 1)]
    for where in bad:
        y[(*where, 0)] += 10 * single
    segments = replace(of.segments, y=y)
    found = fitted(replace(of, system=replace(of.system, r=y), segments=segments))
    weight = found.weight[..., 0]
    # With the variance that it has been given, an outlier is four standard deviations away: (10/4)² or more.
    for where in bad:
        assert weight[where] * found.white[0] ** 2 > 0.5 * (10 / 4) ** 2 * single**2
    # Of 1,440 others 0.1 lie beyond four standard deviations; those beside an outlier may be taken for one.
    assert np.sum(weight > 1) <= 2 * len(bad) + 2
    assert off(found.white[0], of.noise.white[0], 1 / np.sqrt(2 * 1440)) < (5 if not coloured else np.inf)


@pytest.mark.parametrize("drift", [0.0, 0.6])
def test_drift_over_the_session_is_told_from_coloured_noise(drift):
    """Every segment's readings are off by a constant of its own, which is no noise within the segment."""
    S, L = 40, 60
    of = made(11, S=S, L=L, white=(1e-3, 2e-2), coloured=(2e-3, 0.0))
    single = np.hypot(1e-3, 2e-3)
    shape = np.linalg.qr(np.random.default_rng(12).normal(size=(S, 10)))[0] * np.sqrt(S / 10)
    psi = np.zeros((S, L, 2, 10))
    psi[:, :, 0] = shape[:, None]
    off_by = drift * single * shape @ np.random.default_rng(13).normal(size=10)
    y = of.system.r.copy()
    y[..., 0] += off_by[:, None]
    system = replace(of.system, r=y, psi=psi, W=np.zeros((S, L, 2, 10)))
    prior = Prior.of(np.ones(10), DRIFT, np.zeros(10, int))
    found = fitted(replace(of, system=system, segments=replace(of.segments, y=y)), prior)
    if drift:
        # One size from ten draws: a standard error of 1/√20 of the logarithm.
        assert off(found.drift * found.single[0], drift * single, 1 / np.sqrt(20)) < 3
    else:
        assert found.drift * found.single[0] < 0.3 * single
    assert off(found.coloured[0], 2e-3, 0.1) < 3


def test_errors_of_laws_are_recovered():
    of = made(6, S=24, L=60, columns=24, law_error=0.05, white=(1e-4, 2e-3))
    prior = Prior.of(np.ones(24), NOMINAL)
    found = fitted(of, prior)
    # One size from 24 draws, each known well: a standard error of 1/√48 of the logarithm.
    assert off(found.law_error, 0.05, 1 / np.sqrt(48)) < 4
    np.testing.assert_allclose(prior.at(found), found.law_error)
    assert np.all(off(found.white, of.noise.white, 1 / np.sqrt(2 * 1440)) < 5)


@pytest.mark.parametrize(("size", "force"), [(0.05, 1e-3), (1e-4, 0.3)])
def test_forces_are_told_from_errors_of_laws(size, force):
    """Both from the other's size: what no law explains is a force, and the other way round."""
    of = made(6, S=24, L=60, columns=24, law_error=size, force=force, white=(1e-4, 2e-3))
    known = replace(of.noise, force=0.05, law_error=0.02)
    found = fit_process_force(of.system, Prior.of(np.ones(24), NOMINAL), known, INTERVAL)
    if size > force:
        # 24 draws tell the logarithm to 1/√48; the prior, of the usual size, moves it by half of that.
        assert off(found.law_error, size, 1 / np.sqrt(48)) < 5
        assert found.force < 0.01
    else:
        (error,) = standard_errors(of, ("force",))
        assert off(found.force, force, error) < 4
        assert found.law_error < 0.03


def test_the_marginal_likelihood_is_that_of_the_dense_gaussian():
    of = made(7, S=2, L=8, columns=3, law_error=0.1)
    noise = replace(of.noise, initial=np.array([0.5, 0.7]), force=0.2)
    sd = np.array([0.3, 1.0, 2.0])
    found = innovations(of.system, noise.covariances(INTERVAL))
    # Whitened innovations are the data in other coordinates, whose Jacobian is the log determinant.
    z = found.Z.reshape(-1, 3)
    covariance = np.eye(len(z)) + z @ np.diag(sd**2) @ z.T
    e = found.e.reshape(-1)
    expected = multivariate_normal(cov=covariance).logpdf(e) + len(e) / 2 * np.log(2 * np.pi)
    expected -= found.logdet.sum() / 2
    assert marginal_likelihood(found, sd) == pytest.approx(expected, rel=1e-10)
    # What no column explains: the data less their best linear prediction by the columns.
    left = np.linalg.solve(covariance, e)
    np.testing.assert_allclose((found.e - found.Z @ posterior_means(found, sd)).reshape(-1), left, atol=1e-10)
    assert marginal_likelihood(found, 1e-12 * sd) == pytest.approx(log_likelihood(found), rel=1e-12)


def test_few_columns_tell_the_slope_of_the_likelihood_and_its_information():
    """Against differences of the likelihood with all columns.

    A trace is estimated by 16 random directions: its standard error is at most sqrt(2 p / 16) for a factor on
    the noise, with p columns; steps are measured by the information, whose root is more than a hundred.
    """
    of = made(11, columns=6, law_error=0.1, coloured=(5e-4, 1e-2), force=3e-3)
    prior = Prior.of(np.ones(6), NOMINAL)

    def noise(values):
        law, force, white, coloured = np.exp(values)
        return replace(
            of.noise, law_error=law, force=force, white=white * of.noise.white,
            coloured=coloured * of.noise.coloured,
        )  # fmt: skip

    # The first three values are sizes of columns.
    likelihood = NoiseLikelihood(of.system, prior, lambda v: noise(v[[0, 3, 4, 5]]), INTERVAL)
    here = np.log([0.05, 1.0, 1.0, 0.1, 1.3, 0.4])
    limits = np.full(6, -np.inf), np.full(6, np.inf)
    found = likelihood(here)
    slope, information = derivatives(likelihood, found, here, *limits)
    exact, same = derivatives(likelihood, replace(found, near=None), here, *limits)
    assert found.near(here).value == pytest.approx(found.value, abs=1e-6)
    assert slope == pytest.approx(exact, abs=3 * np.sqrt(2 * 6 / 16))
    assert np.abs(exact[3:5]).min() > 40
    assert slope[:3] == pytest.approx(exact[:3], abs=1e-3)
    assert np.diag(information)[3:] == pytest.approx(np.diag(same)[3:], rel=0.1)


def test_outliers_are_given_less_weight():
    of = made(8)
    rng = np.random.default_rng(80)
    struck = rng.random(of.segments.y.shape) < 0.01
    y = of.segments.y + struck * 40 * of.noise.white * rng.choice([-1, 1], struck.shape)
    hit = Made(replace(of.system, r=y), replace(of.segments, y=y), of.noise)
    found = fitted(hit)
    assert np.median(found.weight[struck]) > 5
    assert (found.weight[~struck] > 1).mean() < 0.02
    # With the outliers the noise has 17 times its variance.
    assert np.all(found.white < 1.6 * of.noise.white)
    assert np.all(found.white > 0.8 * of.noise.white)


@pytest.mark.parametrize("growth", [0.0, 0.4])
def test_noise_that_grows_over_the_session_is_weighted(growth):
    of = made(31, S=40, L=60)
    size = np.exp(growth * of.segments.order)[:, None]
    # Readings are linear in the noise: what is added to the first channel is its own, larger or smaller.
    own = np.random.default_rng(32).normal(size=of.segments.y.shape[:2]) * of.noise.white[0]
    added = np.sqrt(3.0) * size * own
    y = of.segments.y.copy()
    y[..., 0] += added
    found = fitted(Made(replace(of.system, r=y), replace(of.segments, y=y), of.noise))
    # Of four parts of the variance three grow; the middle of the session stays.
    variance = of.noise.white[0] ** 2 * (1 + 3 * size[:, 0] ** 2)
    np.testing.assert_allclose(found.usual_variance[:, 0, 0], variance, rtol=4 / np.sqrt(2400 / 2))
    assert found.growth[1] == pytest.approx(0.0, abs=4 / np.sqrt(2 * 2400 / 12))
    elsewhere = found.elsewhere(np.zeros((2, 3, 2)), np.array([-0.5, 0.5]), None)
    np.testing.assert_allclose(elsewhere.variance[:, 1], found.variance[[0, -1], 1], rtol=1e-9)


def test_coloured_noise_grows_as_a_whole():
    """White of 1, coloured of 2: both grow by a factor of 1.6; test_filter tells one from the other."""
    of, sd, growth, S, L = made(35, S=40, L=80, white=(1e-5, 2e-2)), 1e-3, np.log(1.6), 40, 80
    rng, decay = np.random.default_rng(36), np.exp(-INTERVAL / 0.05)
    own = 2 * sd * lfilter([np.sqrt(1 - decay**2)], [1, -decay], rng.normal(size=(S, L + 200)))[:, 200:]
    own = (own + sd * rng.normal(size=(S, L))) * np.exp(growth * of.segments.order)[:, None]
    y = of.segments.y.copy()
    y[..., 0] += own
    found = fitted(Made(replace(of.system, r=y), replace(of.segments, y=y), of.noise))
    # Of a process that is alike for ten samples, 320 values are independent, of which each tells 2 x² of it.
    assert found.growth[0] == pytest.approx(growth, abs=3 / np.sqrt(2 * 320 / 12))
    assert found.coloured[0] == pytest.approx(2 * sd, rel=0.15)
    assert found.white[0] == pytest.approx(sd, rel=0.15)


@pytest.mark.parametrize("each", [1, 6])
def test_errors_in_a_burst_are_no_growth_of_the_noise(each):
    """The last episode, of one segment or six, errs three times as much: by all errors, noise would grow."""
    of = made(33, S=24, L=60)
    y = of.segments.y.copy()
    y[-each:] += 3 * of.noise.white * np.random.default_rng(34).normal(size=y[-each:].shape)
    order = np.repeat(np.linspace(-0.5, 0.5, 24 // each), each)
    segments = replace(of.segments, y=y, order=order)
    found = fitted(Made(replace(of.system, r=y), segments, of.noise))
    np.testing.assert_array_equal(found.growth, 0)


def test_a_sensor_that_is_read_in_two_episodes_tells_no_growth():
    """Any two episodes lie on a line, which would tell growth over 18 others without readings."""
    of = made(37, S=20, L=60)
    y = of.segments.y.copy()
    y[1, :, 0] += 2 * of.noise.white[0] * np.random.default_rng(38).normal(size=60)
    y[2:, :, 0] = np.nan
    found = fitted(Made(replace(of.system, r=y), replace(of.segments, y=y), of.noise))
    assert found.growth[0] == 0
    # One of 1 and one of 1 + 4, outliers apart.
    assert 1.0 < found.white[0] / of.noise.white[0] < np.sqrt(3.0) * 1.2


def test_noise_that_grows_is_nowhere_less_than_the_quantisation():
    of = made(39, S=40, L=60)
    size = np.exp(np.log(3.0) * of.segments.order)[:, None, None]
    y = of.segments.y + 2 * size * of.noise.white * np.random.default_rng(40).normal(size=of.segments.y.shape)
    step = 2.0 * np.sqrt(12) * of.noise.white
    segments = replace(of.segments, y=y, quantisation=step)
    found = fitted(Made(replace(of.system, r=y), segments, of.noise))
    assert np.all(np.sqrt(found.usual_variance) >= step / np.sqrt(12) * (1 - 1e-9))


def test_missing_observations_have_no_say():
    of = made(9)
    y = of.segments.y.copy()
    y[np.random.default_rng(90).random(y.shape) < 0.3] = np.nan
    found = fitted(Made(replace(of.system, r=y), replace(of.segments, y=y), of.noise))
    assert np.all(off(found.white, of.noise.white, 1 / np.sqrt(2 * 650)) < 4)
    assert np.all(found.weight[~np.isfinite(y)] == 1)


def test_noise_is_at_least_that_of_the_steps_of_numbers():
    """An encoder of 2 mrad a count, and hardly any other noise."""
    of = made(10, white=(1e-5, 2e-2))
    step = 2e-3
    y = of.segments.y.copy()
    y[..., 0] = step * np.rint(y[..., 0] / step)
    found = fitted(
        Made(replace(of.system, r=y), replace(of.segments, y=y, quantisation=np.array([step, 0.0])), of.noise)
    )
    # To the square root of 12, as rounding has it, and no more than a little above.
    assert step / np.sqrt(12) * (1 - 1e-9) <= found.white[0] < 1.3 * step / np.sqrt(12)


def test_a_fit_begins_at_the_noise_of_third_differences():
    rng, of = np.random.default_rng(12), made(12)
    slow = np.sin(2 * np.arange(60) * INTERVAL)
    y = slow[:, None] + rng.normal(size=(16, 60, 2)) * [1e-3, 3e-2]
    y[3, 20:] += 5.0  # a jump, as an encoder that wraps round
    y[5, 7, 0] = np.nan
    found = initial_noise(replace(of.segments, y=y), np.array([TORQUE]), 5, np.array([1.0]), np.array([5.0]))
    # The median of 900 third differences, which neighbours share: 6 % a standard deviation.
    np.testing.assert_allclose(found.white, [1e-3, 3e-2], rtol=0.24)
    assert np.all(found.coloured == 0)
    np.testing.assert_allclose(found.initial, [1, 25, 1, 1, 1])
    y[:, np.arange(60) % 4 != 0, 1] = (
        np.nan
    )  # a slow clock: a quarter of the differences, twice the deviation
    slow_clock = initial_noise(
        replace(of.segments, y=y), np.array([TORQUE]), 5, np.array([1.0]), np.array([5.0])
    )
    np.testing.assert_allclose(slow_clock.white, [found.white[0], 3e-2], rtol=0.5)
