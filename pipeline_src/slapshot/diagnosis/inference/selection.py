"""Which columns explain what is left? Log evidence of each group on one quadratic."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.inference.scores import Elimination, Scores


@dataclass(frozen=True)
class Gain:
    """What a group of columns gains over none.

    Attributes:
        log_evidence: nats, by Laplace's method; exact where columns are linear.
        values: (k,) in units of the priors.
    """

    log_evidence: float
    values: Array


def gains(of: Scores, groups: Sequence[NDArray[np.intp]]) -> list[Gain]:
    """Gains of all groups, each by itself."""
    eliminated = Elimination(of)(of.b)
    total, information = eliminated.segment.sum(0), eliminated.information
    found = []
    for group in groups:
        precision = np.eye(len(group)) + information[np.ix_(group, group)]
        values = np.linalg.solve(precision, total[group])
        volume = 0.5 * np.linalg.slogdet(precision)[1]
        found.append(Gain(float(0.5 * total[group] @ values - volume), values))
    return found
