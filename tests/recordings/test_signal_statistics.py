"""What is measured of a channel, against what was put in."""

import numpy as np
import pytest
from slapshot.recordings.signal_statistics import (
    Series,
    channel_statistics,
    noise_sd,
    quantisation_step,
    residuals,
    runs,
    sampling,
    white_noise,
)

from .signal_builder import NOISE, make_signals, with_channel


def uneven(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.cumsum(rng.uniform(0.5e-3, 1.5e-3, count))


@pytest.mark.parametrize("seed", range(3))
def test_a_cubic_leaves_nothing(seed: int) -> None:
    """At times that are not regular; what is left is rounding, 1e-16 of values and weights of about 10."""
    rng = np.random.default_rng(seed)
    t = uneven(rng, 200)
    x = np.polynomial.Polynomial(rng.normal(size=4))(t / t[-1])
    assert np.abs(residuals(t, x)).max() < 1e-14
    assert len(residuals(t[:4], x[:4])) == 0


def test_weights_are_those_of_polynomials() -> None:
    """With a slower method: each sample predicted by a cubic that numpy fits to its neighbours."""
    rng = np.random.default_rng(1)
    t, x = uneven(rng, 30), rng.normal(size=30)
    slow = []
    for i in range(2, 28):
        near = [i - 2, i - 1, i + 1, i + 2]
        at = t[near] - t[i]
        weights = np.array([np.polyfit(at / 1e-3, unit, 3)[-1] for unit in np.eye(4)])
        slow.append((x[i] - weights @ x[near]) / np.sqrt(1 + weights @ weights))
    np.testing.assert_allclose(residuals(t, x), slow, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("sd", [1e-4, 1e-2])
@pytest.mark.parametrize("seed", range(3))
def test_white_noise_on_a_motion_is_found(sd: float, seed: int) -> None:
    """The median's standard error is 1.17 / sqrt(n) of it, and neighbours hang together: 5 % is 3 of them."""
    rng = np.random.default_rng(seed)
    t = uneven(rng, 8000)
    x = np.sin(9 * t) + rng.normal(0, sd, len(t))
    x[[100, 2000]] += 50 * sd  # wrong readings do not matter
    assert white_noise([Series(0, t, x)], float("nan")) == pytest.approx(sd, rel=0.05)


@pytest.mark.parametrize("step", [0.00038147554741741033, 0.011, 0.5])
def test_steps_of_an_encoder_are_found_and_its_rounding_is_noise(step: float) -> None:
    """Rounding errors are even over a step: their sd is step / sqrt(12)."""
    t = np.arange(4000) / 500
    x = np.round(40 * step * np.sin(3.1 * t) / step) * step + 1e-12 * np.random.default_rng(0).normal(
        size=4000
    )
    assert quantisation_step(x) == pytest.approx(step, rel=1e-6)
    assert white_noise([Series(0, t, x)], quantisation_step(x)) >= 0.999999 * step / np.sqrt(12)
    fast = np.round(4000 * np.sin(31 * t)) * step
    assert white_noise([Series(0, t, fast)], step) == pytest.approx(step / np.sqrt(12), rel=0.15)


@pytest.mark.parametrize(
    "x",
    [
        np.random.default_rng(0).normal(size=4000),
        np.random.default_rng(0).normal(size=4000).astype(np.float32).astype(float),
        np.zeros(50),
        np.array([0.0, 1.0, 0.0]),
    ],
    ids=["floats", "float32", "constant", "two values"],
)
def test_numbers_on_no_grid_have_no_step(x: np.ndarray) -> None:
    assert np.isnan(quantisation_step(x))


def test_sampling_counts_what_is_missing() -> None:
    t = np.arange(1000) / 100
    whole = sampling([t, t + 3])
    assert whole.interval_s == pytest.approx(0.01)
    assert (whole.missing, whole.longest_gap_s) == (0.0, 0.0)
    assert whole.jitter < 1e-9
    gone = np.delete(t, [*range(100, 110), 500])
    lost = sampling([gone, t])
    assert lost.missing == pytest.approx(11 / 2000)
    assert lost.longest_gap_s == pytest.approx(0.11)
    assert np.isnan(sampling([t[:1]]).interval_s)


@pytest.mark.parametrize("seed", range(2))
def test_jitter_is_the_sd_of_intervals(seed: int) -> None:
    """Of even delays up to 20 % of the interval, neighbours differ with sd 0.2 sqrt(2 / 12)."""
    late = np.random.default_rng(seed).uniform(0, 0.2, 20_000)
    assert sampling([(np.arange(20_000) + late) / 50]).jitter == pytest.approx(0.2 / np.sqrt(6), rel=0.03)


def test_runs_are_stretches_of_equal_values() -> None:
    first, last = runs(np.array([1.0, 1, 2, 3, 3, 3]))
    assert (first.tolist(), last.tolist()) == ([0, 2, 3], [1, 2, 5])


def test_channels_of_a_recording() -> None:
    recording = make_signals()
    for name, sd in NOISE.items():
        assert channel_statistics(recording, name).noise == pytest.approx(sd, rel=0.15)
        assert noise_sd(recording, name) == channel_statistics(recording, name).noise
    assert noise_sd(with_channel(recording, "q", noise=0.7), "q") == 0.7
    assert channel_statistics(recording, "seen").sampling.interval_s == pytest.approx(1 / 60, rel=0.01)
    assert len(channel_statistics(recording, "seen").series) == 2
