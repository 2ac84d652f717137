"""How many samples an error takes: the unit in which claims compare ways to learn."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def samples_to_reach(curve: Array, error: float) -> float:
    """Samples after which a curve (samples + 1) has come down to `error`, linear in between; inf if never."""
    below = np.flatnonzero(curve <= error)
    if len(below) == 0:
        return np.inf
    n = below[0]
    if n == 0:
        return 0.0
    return float(n - 1 + (curve[n - 1] - error) / (curve[n - 1] - curve[n]))


def samples_needed(curves: Array, reached: Array, samples: Array) -> float:
    """Samples after which the mean of curves (models, tasks, n) has come down to that of `reached`.

    Args:
        curves: errors.
        reached: errors of any shape.
        samples: (n,) whole numbers that the curves were measured after, from 0; straight lines in between.

    Returns:
        The largest of them where the mean never gets there.
    """
    mean = np.interp(np.arange(samples[-1] + 1), samples, curves.mean((0, 1)))
    return min(samples_to_reach(mean, float(reached.mean())), float(samples[-1]))
