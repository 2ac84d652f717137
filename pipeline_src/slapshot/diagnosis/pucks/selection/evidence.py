"""Evidence for a hypothesis: what its parameters explain, against the volume that they could have taken.

About the fit of the nuisance parameters, with score g and information B of a hypothesis's parameters after
the nuisance was projected out, and a prior N(0, (gamma D)^2), D the parameters' scales, the marginal
likelihood exceeds that of no effect by

    log Z(gamma) = g' G (1 + G B G)^-1 G g / 2 - log det(1 + G B G) / 2,   G = gamma D,

and is averaged over sizes gamma, since nobody knows beforehand how large what was left out is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array

SIZES = (0.1, 0.3, 1.0, 3.0)
LARGEST = SIZES[-1]


@dataclass(frozen=True)
class Projected:
    """Scores and information of parameters, the nuisance ones projected out.

    Attributes:
        scores: (n, p) of each hit.
        information: (p, p).
        weights: (q, p) by which the nuisance follows a parameter.
    """

    scores: Array
    information: Array
    weights: Array


def project(information: Array, scores: Array, nuisance: NDArray[np.int64], prior: Array) -> Projected:
    """Project the nuisance columns out of the others.

    Args:
        information: (p, p) summed over hits.
        scores: (n, p).
        nuisance: (q,) columns.
        prior: (q, q) information of their prior.
    """
    others = np.setdiff1d(np.arange(len(information)), nuisance)
    inner = information[np.ix_(nuisance, nuisance)] + prior
    weights = np.asarray(np.linalg.solve(inner, information[np.ix_(nuisance, others)]), float)
    return Projected(
        scores=scores[:, others] - scores[:, nuisance] @ weights,
        information=information[np.ix_(others, others)] - information[np.ix_(others, nuisance)] @ weights,
        weights=weights,
    )


class LinearEvidence:
    """Evidence of one hypothesis for many score vectors."""

    def __init__(self, information: Array, scales: Array, one_sided: bool = False) -> None:
        """Information (p, p) and scales (p,); one-sided: a single parameter that cannot be negative."""
        scaled = information * np.outer(scales, scales)
        values, self._vectors = np.linalg.eigh((scaled + scaled.T) / 2)
        self._values = np.maximum(values, 0.0)
        self._scales, self._one_sided = scales, one_sided

    def log_ratio(self, scores: Array) -> Array:
        """(m,) log evidence against no effect for summed scores (m, p)."""
        terms = self._terms(scores)
        total = np.logaddexp.reduce(terms, axis=0) - np.log(len(SIZES))
        if self._one_sided:
            return np.where(scores[..., 0] > 0, total, np.minimum(total, 0.0) - 1.0)
        return total

    def best_size(self, scores: Array) -> float:
        """Of the prior, for one vector of summed scores (p,)."""
        return SIZES[int(np.argmax(self._terms(scores[None])[:, 0]))]

    def _terms(self, scores: Array) -> Array:
        """(sizes, m) log evidence for each size of the prior."""
        turned = (scores * self._scales) @ self._vectors
        terms = []
        for size in SIZES:
            shrunk = 1 + size**2 * self._values
            gain = (size**2 * turned**2 / shrunk).sum(-1) / 2
            terms.append(gain - np.log(shrunk).sum() / 2)
        return np.stack(terms)

    def estimate(self, scores: Array, size: float = LARGEST) -> Array:
        """(m, p) posterior mean of the parameters for a prior of that size."""
        turned = (scores * self._scales) @ self._vectors
        return (turned * size**2 / (1 + size**2 * self._values)) @ self._vectors.T * self._scales
