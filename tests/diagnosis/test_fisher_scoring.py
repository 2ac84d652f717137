"""Variances of independent Gaussian numbers, whose most likely values are known in closed form."""

import numpy as np
import pytest
from slapshot.arrays import Array
from slapshot.diagnosis.inference.fisher_scoring import Evaluation, maximise

VARIANCES = 4.0, 0.25


class Gaussian:
    """Likelihood of two samples by the logarithms of their standard deviations; counts its evaluations."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        self.samples = [np.sqrt(variance) * rng.standard_normal(500) for variance in VARIANCES]
        self.asked: list[Array] = []

    def __call__(self, values: Array) -> Evaluation:
        self.asked.append(values)
        e = np.concatenate([x / np.exp(v) for x, v in zip(self.samples, values, strict=True)])
        log_variance = np.repeat(2 * values, 500)
        return Evaluation(float(-0.5 * np.sum(e**2 + log_variance)), e, log_variance)

    @property
    def most_likely(self) -> Array:
        return np.array([0.5 * np.log(np.mean(x**2)) for x in self.samples])


def test_the_most_likely_variances_are_reached():
    likelihood = Gaussian()
    value, values = maximise(likelihood, [np.zeros(2)], [(-5.0, 5.0)] * 2, tolerance=1e-6)
    # Each has an information of 1000: a tolerance of 1e-6 nats is one of 1e-4.
    assert values == pytest.approx(likelihood.most_likely, abs=1e-4)
    assert value == pytest.approx(likelihood(likelihood.most_likely).value, abs=1e-5)


def test_a_value_that_its_limits_fix_is_never_moved():
    likelihood = Gaussian()
    _, values = maximise(likelihood, [np.zeros(2)], [(-5.0, 5.0), (0.3, 0.3)], tolerance=1e-6)
    assert values == pytest.approx([likelihood.most_likely[0], 0.3], abs=1e-4)
    assert {asked[1] for asked in likelihood.asked} == {0.3}


def test_near_the_maximum_no_longer_step_is_tried():
    likelihood = Gaussian()
    maximise(likelihood, [likelihood.most_likely + 0.01], [(-5.0, 5.0)] * 2, rounds=1, tolerance=1e-6)
    # The first value, two differences and one step.
    assert len(likelihood.asked) == 4


def test_where_the_curvature_is_small_steps_get_longer():
    """Of a quadratic with a tenth of the curvature that the information promises."""
    asked: list[float] = []

    def evaluate(values: Array) -> Evaluation:
        asked.append(float(values[0]))
        # Innovations whose information is 100; the value has a curvature of 10.
        return Evaluation(-5.0 * float(values[0] - 1.0) ** 2, 10 * values, np.zeros(1))

    maximise(evaluate, [np.zeros(1)], [(-5.0, 5.0)], rounds=1, tolerance=1e-6)
    first, longer = asked[2], asked[3]
    assert longer == pytest.approx(4 * first)
