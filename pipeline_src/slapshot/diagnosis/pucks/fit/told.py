"""Launches of hits that took no part in a fit, the laws that were fitted being given."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter, bounded_step
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.slide.slide_model import Point

STEPS = 6  # of Gauss-Newton


def told_launches(
    fitter: HitFitter, fit: Fit, shown: NDArray[np.bool_] | None = None
) -> tuple[Point, Array, Marginal]:
    """Latents with shared parameters held, their covariance (n, 6, 6), and the hits at the step before.

    Args:
        fitter: of the hits.
        fit: of others.
        shown: (n, frames) that tell launches by themselves; None for all frames and the commands.
    """
    point = Point(fitter.start().latents, fit.point.nuisance, fit.point.effects)
    if shown is not None:
        fitter = fitter.slides_alone(point, shown)
    for _ in range(STEPS):
        marginal = fitter.evaluate(point, [], fit.scatter)
        point = replace(point, latents=bounded_step(point.latents, marginal.step))
    return point, marginal.covariance, marginal
