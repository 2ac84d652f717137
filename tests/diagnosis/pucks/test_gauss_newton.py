"""Steps of single hits where Newton's own overshoot, and of parameters at their bounds."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from slapshot.diagnosis.pucks.fit.gauss_newton import GaussNewton
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.slide.slide_model import Column, Point
from slapshot.effects.effect import Parameter

PARAMETERS = [Parameter(f"weight_{k}", "1", -1.0, 1.0, 1.0, "weight") for k in range(5)]


@dataclass
class Arctangents(GaussNewton):
    """Of n hits with one unknown u each: residual SIZE arctan(u), for which Newton diverges beyond 1.39."""

    iterations = 60
    first_scatter = None
    size = 1000.0

    def __init__(self):
        super().__init__({})

    def columns(self, effects):
        return []

    def evaluate(self, point, columns, scatter):
        u = point.latents[:, 0]
        n, residual = len(u), self.size * np.arctan(u)
        step = -(np.arctan(u) * (1 + u**2))[:, None]
        return Marginal(
            np.zeros((n, 0, 0)),
            np.zeros((n, 0)),
            residual**2,
            np.zeros(n),
            step,
            np.zeros((n, 1, 1)),
            np.zeros((n, 1, 0)),
        )

    def freedom(self):
        return np.ones(1)

    def _scatter(self, point, state, before):
        return None

    def _moved_latents(self, point, shift, state, trust):
        return point.latents + trust[:, None] * state.step

    def quadratic(self, fit, effects):
        raise NotImplementedError

    def _moved_by(self, fit, name):
        raise NotImplementedError


@pytest.mark.parametrize("start", [[2.0], [2.0, 0.5, -3.0, 0.1]])
def test_a_hit_whose_step_makes_it_worse_takes_shorter_ones(start):
    """Whether it is alone or one of many whose own steps are good."""
    fit = Arctangents().fit(Point(np.array(start)[:, None], np.zeros((0, 3))))
    assert fit.converged
    assert np.abs(fit.point.latents).max() < 1e-3


class Estimated(Arctangents):
    """One hit whose objective is what is estimated to be its scatter, one value after the other."""

    first_scatter = 1e5
    iterations = 30

    def __init__(self, scatters):
        super().__init__()
        self.scatters = iter(scatters)

    def evaluate(self, point, columns, scatter):
        return replace(super().evaluate(point, columns, scatter), squares=np.array([scatter]))

    def _scatter(self, point, state, before):
        return next(self.scatters)


def test_a_fit_that_wavers_has_arrived_at_the_lowest_of_its_places_and_one_that_falls_has_not():
    start = Point(np.zeros((1, 1)), np.zeros((0, 3)))
    falls = 1e5 - 5 * np.arange(1, 31)
    wavers = Estimated([*falls[:8], *np.tile([99_963.0, 99_960.0, 99_966.0], 10)]).fit(start)
    assert wavers.converged
    assert wavers.objective == wavers.scatter == 99_960
    falling = Estimated(falls).fit(start)
    assert not falling.converged
    assert falling.objective == falls[-1]


class _Bounded(Arctangents):
    """Only its steps are asked for; parameters of one effect between -1 and 1."""

    def __init__(self):
        self.effects = {"field": SimpleNamespace(parameters=tuple(PARAMETERS))}


def test_a_step_at_bounds_is_that_of_bounded_least_squares():
    """Where parameters at their bounds are the only ones that would leave, against scipy's solver."""
    rng, checked = np.random.default_rng(0), 0
    columns = [Column("field", p.name, -1, 0.1) for p in PARAMETERS]
    low, high = np.full(len(PARAMETERS), -1.0), np.full(len(PARAMETERS), 1.0)
    for _ in range(200):
        design = rng.normal(size=(8, len(PARAMETERS)))
        target = 0.3 * rng.normal(size=8)
        at = np.where(rng.uniform(size=len(PARAMETERS)) < 0.5, 1.0, 0.0)
        point = Point(
            np.zeros((0, 6)),
            np.zeros((0, 3)),
            {"field": dict(zip([p.name for p in PARAMETERS], at, strict=True))},
        )
        step = _Bounded()._step(design.T @ design, design.T @ target, point, columns)
        assert (step[at == 1] <= 0).all()
        exact = lsq_linear(design, target, (low - at, np.where(at == 1, 1e-12, high - at)), tol=1e-14).x
        inside = np.abs(at + exact)[at == 0].max(initial=0) < 0.99 and (at + exact).min() > -0.99
        if inside and np.allclose(step == 0, np.abs(exact) < 1e-6):
            np.testing.assert_allclose(step, exact, atol=1e-6)
            checked += 1
    assert checked > 100
