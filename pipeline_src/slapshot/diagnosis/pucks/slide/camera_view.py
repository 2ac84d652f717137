"""What effects of the camera make of where objects lay."""

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.slide.slide_model import Values
from slapshot.effects.effect import Effect

INVERSIONS = 20  # rounds, each of which leaves the share by which the camera stretches, at most 0.35


def start_shift(effect: Effect, values: Values, starts: Array, camera: Array) -> Array:
    """(n, 2) m by which objects really lay elsewhere than a camera saw them, at `starts` (n, 2)."""
    if not effect.acts_on_camera:
        return np.zeros_like(starts)
    each = {name: np.full(len(starts), value) for name, value in values.items()}
    real = starts
    for _ in range(INVERSIONS):
        real = real + starts - effect.see(each, real[:, None], camera)[:, 0]
    return real - starts
