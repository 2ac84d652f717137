"""Approximate Bayesian computation: which simulated conditions look to the model as a rig does.

A rig's posterior over the randomised parameters is that of the simulated conditions whose summary lies
nearest to the rig's, each moved to where a local linear regression on the summary would have it (Beaumont,
Zhang and Balding 2002, "Approximate Bayesian computation in population genetics", equations 2 to 4).
"""

import numpy as np

from slapshot.arrays import Array

_RIDGE = 1e-3  # of a metric's mean eigenvalue: two halves of a sequence can agree in a direction


def metric_of(first: Array, second: Array) -> Array:
    """(d, d) precision of a summary's noise, from pairs (n, d) that share a condition and differ by chance.

    The covariance of a summary about its condition's mean is half that of a pair's difference.
    """
    covariance: Array = np.cov(first - second, rowvar=False).reshape(first.shape[1], -1) / 2
    covariance += _RIDGE * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    return np.asarray(np.linalg.inv(covariance), np.float64)


def posterior(
    summaries: Array, parameters: Array, observed: Array, metric: Array, count: int
) -> tuple[Array, Array]:
    """Parameters that an observed summary could come from, and their weights.

    Args:
        summaries: (n, d) of simulated conditions.
        parameters: (n, p) that they were simulated with, on a scale without bounds.
        observed: (d,).
        metric: (d, d), of distances between summaries.
        count: of the nearest that are kept; the farthest of them has no weight.

    Returns:
        (count, p) parameters after the regression, and (count,) weights that sum to 1.
    """
    off = summaries - observed
    squared = np.einsum("nd,de,ne->n", off, metric, off)
    kept = np.argsort(squared, kind="stable")[:count]
    near, farthest = squared[kept], squared[kept][-1]
    weights = 1 - near / farthest if farthest > 0 else np.ones(len(kept))
    weights = np.maximum(weights, 1e-9)
    # Weighted least squares of the parameters on the offset of summaries.
    inputs = np.column_stack([np.ones(len(kept)), off[kept]])
    root = np.sqrt(weights)[:, None]
    slopes = np.linalg.lstsq(root * inputs, root * parameters[kept], rcond=None)[0]
    return parameters[kept] - off[kept] @ slopes[1:], weights / weights.sum()


def quantiles(values: Array, weights: Array, shares: tuple[float, ...]) -> Array:
    """(shares, p) weighted quantiles of values (n, p): where the cumulative weight reaches a share."""
    found = np.empty((len(shares), values.shape[1]))
    for column in range(values.shape[1]):
        order = np.argsort(values[:, column])
        cumulative = np.cumsum(weights[order]) - weights[order] / 2
        found[:, column] = np.interp(shares, cumulative / weights.sum(), values[order, column])
    return found
