"""Launches told from some of the frames of each hit, the law of the slide being given."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.gauss_newton import Fit
from slapshot.diagnosis.pucks.slide_fit import SlideFitter, bounded_step
from slapshot.diagnosis.pucks.slide_model import Point

STEPS = 6  # of Gauss-Newton


def told_launches(fitter: SlideFitter, fit: Fit, shown: NDArray[np.bool_]) -> tuple[Point, Array]:
    """Latents from the frames shown, shared parameters held, and their covariance (n, 6, 6)."""
    start = fitter.start()
    point = Point(start.latents, fit.point.nuisance, fit.point.effects)
    covariance = np.empty(0)
    for _ in range(STEPS):
        marginal = fitter.evaluate(point, [], fit.scatter, shown)
        point = replace(point, latents=bounded_step(point.latents, marginal.step))
        covariance = marginal.covariance
    return point, covariance
