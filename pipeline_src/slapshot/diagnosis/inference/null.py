"""Is there a mismatch? A p-value by draws in the space of scores.

No simulation is needed: under the null, scores are Gaussian with covariance H, segment by segment, plus what
the nuisance does. Everything that is done to the data's scores is done to those of every draw.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.inference.scores import Draws, Elimination, Scores, group_statistics

DRAWS = 499


@dataclass(frozen=True)
class MismatchTest:
    """Outcome.

    Attributes:
        p_value: of the largest statistic of all groups.
        statistics: (groups,) -log p of each group by itself.
        largest: index of the group with the largest.
        push_p_value: of the largest force in a short window; 1 where none was looked for.
    """

    p_value: float
    statistics: Array
    largest: int
    push_p_value: float = 1.0


def mismatch_test(
    of: Scores, groups: Sequence[NDArray[np.intp]], rng: np.random.Generator, count: int = DRAWS
) -> MismatchTest:
    """Test all groups of candidate columns at once.

    Args:
        of: scores in units of the priors.
        groups: indices of each group among the candidates.
        rng: for draws.
        count: of draws.
    """
    eliminate = Elimination(of)
    seen = group_statistics(eliminate(of.b), groups)
    draws = Draws(of, rng)
    largest = np.concatenate(
        [group_statistics(eliminate(draws(part)), groups).max(-1) for part in _parts(count, 100)]
    )
    exceeding = int(np.sum(largest >= seen.max()))
    return MismatchTest((1 + exceeding) / (count + 1), seen, int(np.argmax(seen)))


def _parts(count: int, size: int) -> list[int]:
    return [size] * (count // size) + ([count % size] if count % size else [])
