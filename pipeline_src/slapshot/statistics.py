"""Confidence intervals and principal components for figures, claims and validations."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Array = NDArray[np.floating]


@dataclass(frozen=True)
class Interval:
    """An estimate and the 95 % interval around it."""

    value: float
    low: float
    high: float


def wilson_interval(successes: int, count: int) -> Interval:
    """A proportion with Wilson's 95 % interval; NaN if the count is 0."""
    if not count:
        return Interval(np.nan, np.nan, np.nan)
    z, share = float(ndtri(0.975)), successes / count
    whole = 2 * (count + z**2)
    middle = (2 * successes + z**2) / whole
    half = z / whole * float(np.sqrt(4 * successes * (1 - share) + z**2))
    low, high = 0.0 if successes == 0 else middle - half, 1.0 if successes == count else middle + half
    return Interval(share, low, high)


def bootstrap(
    statistic: Callable[..., float],
    *tables: Array,
    tasks: Sequence[int] | None = None,
    draws: int = 2000,
    seed: int = 0,
) -> Interval:
    """Percentile interval of a statistic of tables (models, tasks, ...), over both models and tasks.

    Models and tasks are crossed factors: every model is evaluated on every task. Each draw resamples models
    and tasks independently, the same ones in every table, so that common variation cancels in differences
    of tables. With the usual handful of models the interval is somewhat too narrow (the variance of m
    resampled models is (m - 1) / m of the true one).

    Args:
        statistic: of the tables, each (models, tasks, ...).
        tables: of the same models, and of the same tasks unless `tasks` is given.
        tasks: an index for each table, equal for tables with the same tasks.
        draws: number of resamples.
        seed: of the resampling.
    """
    rng = np.random.default_rng(seed)
    groups = [0] * len(tables) if tasks is None else list(tasks)
    models = len(tables[0])
    counts = {group: table.shape[1] for group, table in zip(groups, tables, strict=True)}
    values = []
    for _ in range(draws):
        m = rng.integers(models, size=models)
        t = {group: rng.integers(count, size=count) for group, count in counts.items()}
        values.append(statistic(*(table[m][:, t[g]] for table, g in zip(tables, groups, strict=True))))
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return Interval(float(statistic(*tables)), float(low), float(high))


@dataclass(frozen=True)
class Projection:
    """Projection on the first principal components of a set of vectors.

    Attributes:
        mean: (h).
        axes: (components, h), orthonormal, in order of decreasing variance.
        explained: (components) share of the variance.
    """

    mean: Array
    axes: Array
    explained: Array

    def apply(self, vectors: Array) -> Array:
        """Project vectors (..., h) to (..., components)."""
        return (vectors - self.mean) @ self.axes.T

    def oriented(self, vectors: Array, *guides: Array) -> "Projection":
        """The same axes, with the first ones oriented to increase with their guides (one value per vector).

        An axis whose guide does not vary is unchanged.
        """
        scores = self.apply(vectors)
        signs = np.ones(len(self.axes))
        for i, guide in enumerate(guides[: len(signs)]):
            if np.ptp(guide) > 0 and np.corrcoef(scores[:, i], guide)[0, 1] < 0:
                signs[i] = -1
        return Projection(self.mean, self.axes * signs[:, None], self.explained)


def principal_components(vectors: Array, count: int) -> Projection:
    """PCA of vectors (n, h) by singular value decomposition."""
    mean = vectors.mean(0)
    _, scales, axes = np.linalg.svd(vectors - mean, full_matrices=False)
    variance = scales**2
    return Projection(mean, axes[:count], variance[:count] / variance.sum())
