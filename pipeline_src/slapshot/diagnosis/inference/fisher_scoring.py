"""Fisher scoring: the highest likelihood of a few variances, within limits.

Derivatives are differences. The information is that of Gaussian innovations e with variances s,
Σ ½ ∂(log s) ∂(log s)ᵀ + ∂ν ∂νᵀ / s, where ν = e √s (Harvey 1989, 3.4.6): steps need no second derivatives and
know how far to go in every direction, so that a few rounds suffice.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from slapshot.arrays import Array

_DIFFERENCE = 1e-4
_MOST_ROUNDS = 40
_LARGEST = 2.0  # step in the logarithm of a variance's root
_FURTHER = 3.0
_DAMPINGS = (0.0, 0.1, 1.0, 10.0, 100.0, 1e4)


@dataclass(frozen=True)
class Evaluation:
    """A likelihood at one place.

    Attributes:
        value: logarithm of the likelihood; -inf where there is none.
        e: (n,) whitened innovations.
        log_variance: (n,) logarithms of their variances.
        information: of values that the innovations do not know of, by their index.
    """

    value: float
    e: Array
    log_variance: Array
    information: Mapping[int, float] = field(default_factory=dict)


def maximise(
    evaluate: Callable[[Array], Evaluation],
    begins: Sequence[Array],
    limits: Sequence[tuple[float, float]],
    rounds: int = _MOST_ROUNDS,
    still: float = 0.01,
) -> tuple[float, Array]:
    """The highest log-likelihood that is reached from the best of some starts, and where.

    Args:
        evaluate: likelihood at some values.
        begins: (p,) values each.
        limits: lowest and highest of each value.
        rounds: at most.
        still: nats that a round could still gain at the end.
    """
    low, high = np.array(limits).T
    starts = [np.clip(begin, low, high) for begin in begins]
    found = [evaluate(start) for start in starts]
    best = int(np.argmax([one.value for one in found]))
    here, values = found[best], starts[best]
    if not np.isfinite(here.value):
        return here.value, values
    for _ in range(rounds):
        gradient, information = _derivatives(evaluate, here, values, high)
        stuck = ((values <= low) & (gradient < 0)) | ((values >= high) & (gradient > 0))
        free = np.flatnonzero(~stuck)
        before = here.value
        for damping in _DAMPINGS:
            step = np.zeros(len(values))
            # One nat for each value keeps steps small where the data say nothing.
            part = information[np.ix_(free, free)]
            stiff = part + damping * np.diag(np.diag(part)) + np.eye(len(free))
            step[free] = np.linalg.solve(stiff, gradient[free])
            step *= min(1.0, _LARGEST / max(np.abs(step).max(), 1e-12))
            target = np.clip(values + step, low, high)
            if damping == 0.0 and gradient @ (target - values) < 2 * still:
                return here.value, values
            there = evaluate(target)
            if there.value > here.value:
                break
        # Where the likelihood bends less than it is expected to, the way goes on.
        while there.value > here.value:
            here, values, step = there, target, _FURTHER * step
            target = np.clip(values + step, low, high)
            there = evaluate(target)
        if here.value - before < still / 10:
            break
    return here.value, values


def _derivatives(
    evaluate: Callable[[Array], Evaluation], here: Evaluation, values: Array, high: Array
) -> tuple[Array, Array]:
    """Gradient (p,) and expected information (p, p)."""
    p = len(values)
    gradient = np.zeros(p)
    along, spread = np.empty((p, len(here.e))), np.empty((p, len(here.e)))
    for i in range(p):
        step = -_DIFFERENCE if values[i] + _DIFFERENCE > high[i] else _DIFFERENCE
        there = evaluate(values + step * np.eye(p)[i])
        gradient[i] = (there.value - here.value) / step
        spread[i] = (there.log_variance - here.log_variance) / step
        along[i] = (there.e - here.e) / step + 0.5 * here.e * spread[i]
    information = 0.5 * spread @ spread.T + along @ along.T
    for index, more in here.information.items():
        information[index, index] += more
    return gradient, information
