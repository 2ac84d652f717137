"""Steps of single hits, on a residual for which Newton's own step overshoots."""

from dataclasses import dataclass

import numpy as np
import pytest
from slapshot.diagnosis.pucks.gauss_newton import GaussNewton
from slapshot.diagnosis.pucks.marginal import Marginal
from slapshot.diagnosis.pucks.slide_model import Point


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
