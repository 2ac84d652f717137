"""Fisher scoring: maximise a likelihood over a few variances within bounds.

Derivatives are finite differences. The information is that of Gaussian innovations e with variances s,
Σ ½ ∂(log s) ∂(log s)ᵀ + ∂ν ∂νᵀ / s, where ν = e √s (Harvey 1989, 3.4.6): steps need no second derivatives and
are scaled in every direction, so that a few rounds suffice.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from slapshot.arrays import Array

_DIFFERENCE = 1e-4
_MOST_ROUNDS = 40
_LARGEST = 2.0  # step in the logarithm of a variance's root
_EXTENSION, _STRAIGHT = 3.0, 0.75
_DAMPINGS = (0.0, 0.1, 1.0, 10.0, 100.0, 1e4)


@dataclass(frozen=True)
class Evaluation:
    """A likelihood evaluated at one point.

    Attributes:
        value: logarithm of the likelihood; -inf where there is none.
        e: (n,) whitened innovations.
        log_variance: (n,) logarithms of their variances.
        information: of values on which the innovations do not depend, by index.
        near: evaluates values near these, to first order in the difference, at less cost; None where there
            is no cheaper way.
    """

    value: float
    e: Array
    log_variance: Array
    information: Mapping[int, float] = field(default_factory=dict)
    near: "Callable[[Array], Evaluation] | None" = None


def maximise(
    evaluate: Callable[[Array], Evaluation],
    initial_points: Sequence[Array],
    limits: Sequence[tuple[float, float]],
    rounds: int = _MOST_ROUNDS,
    tolerance: float = 0.01,
) -> tuple[float, Array]:
    """The highest log-likelihood reached from the best of several initial points, and its location.

    Args:
        evaluate: likelihood at some values.
        initial_points: (p,) values each.
        limits: lowest and highest of each value.
        rounds: at most.
        tolerance: gain in nats per round below which the search stops.
    """
    low, high = np.array(limits).T
    starts = [np.clip(initial_point, low, high) for initial_point in initial_points]
    found = [evaluate(start) for start in starts]
    best = int(np.argmax([one.value for one in found]))
    here, values = found[best], starts[best]
    if not np.isfinite(here.value):
        return here.value, values
    for _ in range(rounds):
        gradient, information = derivatives(evaluate, here, values, low, high)
        stuck = ((values <= low) & (gradient < 0)) | ((values >= high) & (gradient > 0))
        free = np.flatnonzero(~stuck)
        before = here.value
        for damping in _DAMPINGS:
            step = np.zeros(len(values))
            # A unit prior for each value keeps steps small where the data carry no information.
            part = information[np.ix_(free, free)]
            stiff = part + damping * np.diag(np.diag(part)) + np.eye(len(free))
            step[free] = np.linalg.solve(stiff, gradient[free])
            step *= min(1.0, _LARGEST / max(np.abs(step).max(), 1e-12))
            target = np.clip(values + step, low, high)
            if damping == 0.0 and gradient @ (target - values) < 2 * tolerance:
                return here.value, values
            there = evaluate(target)
            if there.value > here.value:
                break
        # Where the curvature is smaller than expected, the step is extended. On a parabola three steps gain
        # more than one only where that gains more than three quarters of what its slope promises.
        extend = there.value - here.value > _STRAIGHT * gradient @ (target - values)
        while there.value > here.value:
            here, values, step = there, target, _EXTENSION * step
            if not extend:
                break
            target = np.clip(values + step, low, high)
            there = evaluate(target)
        if here.value - before < tolerance / 10:
            break
    return here.value, values


def derivatives(
    evaluate: Callable[[Array], Evaluation], here: Evaluation, values: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Gradient (p,) and expected information (p, p); 0 for values that are fixed by their limits."""
    p, evaluate = len(values), here.near or evaluate
    gradient = np.zeros(p)
    along, spread = np.zeros((p, len(here.e))), np.zeros((p, len(here.e)))
    for i in np.flatnonzero(low < high):
        step = -_DIFFERENCE if values[i] + _DIFFERENCE > high[i] else _DIFFERENCE
        there = evaluate(values + step * np.eye(p)[i])
        gradient[i] = (there.value - here.value) / step
        spread[i] = (there.log_variance - here.log_variance) / step
        along[i] = (there.e - here.e) / step + 0.5 * here.e * spread[i]
    information = 0.5 * spread @ spread.T + along @ along.T
    for index, more in here.information.items():
        information[index, index] += more
    return gradient, information
