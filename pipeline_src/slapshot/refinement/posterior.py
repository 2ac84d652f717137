"""Approximate Bayesian computation: posterior of a rig's parameters from simulated conditions like it.

The posterior over the randomised parameters is represented by the simulated conditions whose summaries are
nearest to the rig's, after local linear regression adjustment on the summary (Beaumont, Zhang and Balding
2002, "Approximate Bayesian computation in population genetics", equations 2 to 4).
"""

import numpy as np

from slapshot.arrays import Array

_RIDGE = 1e-3  # relative to the metric's mean eigenvalue, for directions in which all pairs agree


def metric_of(first: Array, second: Array) -> Array:
    """Precision (d, d) of a summary's noise, from pairs (n, d) of independent summaries of one condition.

    The covariance of a summary about its condition's mean is half that of the difference of a pair.
    """
    covariance: Array = np.cov(first - second, rowvar=False).reshape(first.shape[1], -1) / 2
    covariance += _RIDGE * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    return np.asarray(np.linalg.inv(covariance), np.float64)


def posterior(
    summaries: Array, parameters: Array, observed: Array, metric: Array, count: int
) -> tuple[Array, Array]:
    """Weighted sample of the parameters given an observed summary.

    Args:
        summaries: (n, d) of simulated conditions.
        parameters: (n, p) of the same conditions, on an unbounded scale.
        observed: (d,) summary.
        metric: (d, d), for distances between summaries.
        count: number of nearest conditions that are kept; the farthest of them has weight 0.

    Returns:
        Adjusted parameters (count, p), and weights (count,) that sum to 1.
    """
    off = summaries - observed
    squared = np.einsum("nd,de,ne->n", off, metric, off)
    kept = np.argsort(squared, kind="stable")[:count]
    near, farthest = squared[kept], squared[kept][-1]
    weights = 1 - near / farthest if farthest > 0 else np.ones(len(kept))
    weights = np.maximum(weights, 1e-9)
    # Weighted least squares of the parameters on the offsets of the summaries.
    inputs = np.column_stack([np.ones(len(kept)), off[kept]])
    root = np.sqrt(weights)[:, None]
    slopes = np.linalg.lstsq(root * inputs, root * parameters[kept], rcond=None)[0]
    return parameters[kept] - off[kept] @ slopes[1:], weights / weights.sum()


def quantiles(values: Array, weights: Array, shares: tuple[float, ...]) -> Array:
    """Weighted quantiles (shares, p) of values (n, p): where the cumulative weight reaches each share."""
    found = np.empty((len(shares), values.shape[1]))
    for column in range(values.shape[1]):
        order = np.argsort(values[:, column])
        cumulative = np.cumsum(weights[order]) - weights[order] / 2
        found[:, column] = np.interp(shares, cumulative / weights.sum(), values[order, column])
    return found
