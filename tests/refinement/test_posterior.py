"""Approximate Bayesian computation where the exact posterior is known: a linear Gaussian world."""

import numpy as np
import pytest
from slapshot.refinement.posterior import metric_of, posterior, quantiles

NOISE = 0.3


def world(count: int, seed: int = 0):
    """Parameters ~ N(0, I) of two dimensions, summaries A theta + noise, of three."""
    rng = np.random.default_rng(seed)
    mix = np.array([[1.0, 0.2], [-0.5, 0.8], [0.3, 0.3]])
    parameters = rng.normal(size=(count, 2))
    clean = parameters @ mix.T
    first, second = (clean + NOISE * rng.normal(size=(count, 3)) for _ in range(2))
    return mix, parameters, first, second


def exact(mix, observed):
    """Mean and covariance of the conjugate posterior."""
    covariance = np.linalg.inv(np.eye(2) + mix.T @ mix / NOISE**2)
    return covariance @ mix.T @ observed / NOISE**2, covariance


def test_the_metric_is_the_precision_of_the_noise():
    _, _, first, second = world(50_000)
    # A variance from n pairs is off by sqrt(2 / n) of itself: 6 sd, and the ridge.
    np.testing.assert_allclose(metric_of(first, second), np.eye(3) / NOISE**2, atol=0.06 / NOISE**2)


@pytest.mark.parametrize("observed", [[0.0, 0.0, 0.0], [1.0, 0.4, 0.5], [-2.0, 1.5, 0.1]])
def test_the_posterior_is_the_exact_one_where_that_is_known(observed):
    mix, parameters, first, second = world(20_000)
    values, weights = posterior(first, parameters, np.array(observed), metric_of(first, second), 1000)
    mean, covariance = exact(mix, np.array(observed))
    sd = np.sqrt(np.diag(covariance))
    # The mean of 1000 weighted draws (some 500 effective): 6 standard errors.
    assert np.abs(weights @ values - mean).max() < 6 * sd.max() / np.sqrt(500)
    low, high = quantiles(values, weights, (0.05, 0.95))
    assert high - low == pytest.approx(2 * 1.645 * sd, rel=0.2)


def test_ninety_per_cent_intervals_hold_the_truth_in_ninety_per_cent():
    mix, parameters, first, second = world(6000)
    metric = metric_of(first, second)
    _, truths, observed, _ = world(200, seed=9)
    inside = []
    for truth, seen in zip(truths, observed, strict=True):
        values, weights = posterior(first, parameters, seen, metric, 300)
        low, high = quantiles(values, weights, (0.05, 0.95))
        inside.append((low < truth) & (truth < high))
    # Binomial with n = 200: 4 sd are 0.085.
    assert np.mean(inside, axis=0) == pytest.approx(0.9, abs=0.085)
    assert mix.shape == (3, 2)


def test_what_a_summary_does_not_tell_keeps_its_prior():
    _, _, first, second = world(6000)
    parameters = np.random.default_rng(5).uniform(-1, 1, (6000, 1))
    values, weights = posterior(first, parameters, np.zeros(3), metric_of(first, second), 600)
    low, high = quantiles(values, weights, (0.05, 0.95))[:, 0]
    assert (low, high) == pytest.approx((-0.9, 0.9), abs=0.15)


def test_weighted_quantiles():
    values = np.array([[3.0], [1.0], [2.0], [10.0]])
    even = quantiles(values, np.ones(4), (0.5,))
    assert even[0, 0] == pytest.approx(2.5)
    heavy = quantiles(values, np.array([1.0, 1.0, 1.0, 97.0]), (0.5,))
    assert heavy[0, 0] > 6
