"""Observation noise and process force, fitted by likelihood.

Each channel has white noise (never less than its quantisation) and coloured noise, an Ornstein-Uhlenbeck
process; both channels of one quantity share the ratio of the two and the correlation time. What the model leaves
out acts as a white process force, in shares of the torque that moves each joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from slapshot.diagnosis.filter import Covariances, Innovations, Linear, innovations
from slapshot.diagnosis.segments import Segments

Array = NDArray[np.float64]

HELD_S = 0.01  # process force is told as the standard deviation of a force held so long
CLIP = 4.0  # standard deviations beyond which an observation counts as an outlier
_WORTH = 4.0  # nats by which coloured noise must raise the likelihood: twice its two parameters
_SEARCH_NODES = 4000


@dataclass(frozen=True)
class Noise:
    """Noise of a recording under a model.

    Attributes:
        white: (ny,) standard deviation.
        coloured: (ny,) standard deviation.
        correlation_s: (ny,) correlation time of the coloured part.
        force: process force over `torque`, as the sd of a force held for `HELD_S`.
        torque: (nv,) N m or N, scale of forces.
        initial: (n,) variances of a segment's first state about the path.
        weight: (S, L, ny) factor on the white variance; more than 1 for outliers.
    """

    white: Array
    coloured: Array
    correlation_s: Array
    force: float
    torque: Array
    initial: Array
    weight: Array

    def covariances(self, interval: float, segments: NDArray[np.intp] | None = None) -> Covariances:
        """What the filter takes."""
        weight = self.weight if segments is None else self.weight[segments]
        return Covariances(
            self.initial,
            (self.force * self.torque) ** 2 * (HELD_S / interval),
            weight * self.white**2,
            self.coloured**2,
            np.exp(-interval / self.correlation_s),
        )


def log_likelihood(found: Innovations) -> float:
    """Of all observations, without constants."""
    return float(-0.5 * (np.sum(found.e**2) + found.logdet.sum()))


def quantisation(values: Array) -> float:
    """Step of a channel's numbers; 0 where it cannot be seen."""
    there = np.unique(values[np.isfinite(values)])
    if len(there) < 20:
        return 0.0
    gaps = np.diff(there)
    step = float(np.median(gaps[gaps > 1e-12 * max(1.0, np.abs(there).max())][:2000]))
    multiples = gaps / step
    regular = np.mean(np.abs(multiples - np.rint(multiples)) < 0.05)
    return step if regular > 0.95 and np.median(multiples) < 1.5 else 0.0


def first_noise(segments: Segments, torque: Array, n: int, position: Array, speed: Array) -> Noise:
    """Where a fit begins: white noise from third differences of what was recorded.

    Args:
        segments: data.
        torque: (nv,) scale of forces.
        n: length of a change of state.
        position: (nv,) wide standard deviations of a first position about the path.
        speed: (nv,) the same of a velocity.
    """
    third = np.diff(segments.y, n=3, axis=1)
    # Third differences of white noise have 20 times its variance; the median leaves jumps out.
    white = np.nanmedian(np.abs(third), axis=(0, 1)) / 0.6745 / np.sqrt(20)
    spread = np.nanstd(segments.y, axis=(0, 1))
    white = np.maximum(np.nan_to_num(white), np.maximum(1e-6 * np.nan_to_num(spread), 1e-9))
    initial = np.concatenate([position**2, speed**2, np.ones(n - 2 * len(torque))])
    ny = segments.y.shape[2]
    return Noise(white, np.zeros(ny), np.full(ny, 0.05), 1e-2, torque, initial, np.ones_like(segments.y))


def fit_noise(
    system: Linear, noise: Noise, segments: Segments, kinds: Sequence[str], *, colour: bool = True
) -> Noise:
    """Noise of the highest likelihood, the system's parameters being given.

    Args:
        system: linearised; its columns are ignored.
        noise: where the search begins.
        segments: data.
        kinds: quantity of each channel; channels of one kind share ratio and correlation time of coloured noise.
        colour: whether coloured noise may be there.
    """
    S, L = segments.shape
    noise = replace(noise, weight=np.ones_like(noise.weight))
    some = np.unique(np.linspace(0, S - 1, max(8, min(S, _SEARCH_NODES // L))).astype(int))
    part = system.without_columns().select(some)
    groups = sorted(set(kinds))
    member = np.array([groups.index(kind) for kind in kinds])
    least = np.array([quantisation(segments.y[..., c]) / np.sqrt(12) for c in range(len(kinds))])

    def of(values: Array, with_colour: bool) -> Noise:
        white = np.maximum(noise.white * np.exp(values[1 : 1 + len(groups)])[member], least)
        if not with_colour:
            return replace(noise, force=float(np.exp(values[0])), white=white, coloured=0 * white)
        ratio, time = np.exp(values[1 + len(groups) :]).reshape(2, len(groups))
        return replace(
            noise, force=float(np.exp(values[0])), white=white,
            coloured=white * ratio[member], correlation_s=time[member],
        )  # fmt: skip

    def cost(values: Array, with_colour: bool) -> float:
        candidate = of(values, with_colour)
        found = innovations(part, candidate.covariances(segments.interval, some))
        value = -log_likelihood(found)
        return value if np.isfinite(value) else 1e12

    zero = np.zeros(len(groups))
    begins = [
        (cost(v, False), v)
        for v in (np.concatenate([[np.log(force)], zero]) for force in {1e-5, 1e-3, 1e-2, 1e-1, noise.force})
    ]
    start = min(begins, key=lambda pair: pair[0])[1]
    limits = [(np.log(1e-6), np.log(1e2))] + [(-7.0, 7.0)] * len(groups)
    plain = minimize(cost, start, (False,), "L-BFGS-B", bounds=limits, options={"maxiter": 15})
    best = of(plain.x, False)
    if colour:
        longest = max(2 * segments.interval, L * segments.interval / 2)
        limits += [(np.log(0.05), np.log(30.0))] * len(groups)
        limits += [(np.log(segments.interval), np.log(longest))] * len(groups)
        trials = []
        for ratio in (0.5, 2.0):
            for time in (4 * segments.interval, longest / 3):
                for force in (plain.x[0], np.log(1e-4)):
                    extra = np.concatenate([zero + np.log(ratio), zero + np.log(time)])
                    values = np.concatenate([[force], plain.x[1:] - 0.5 * np.log1p(ratio**2), extra])
                    values = np.clip(values, *np.array(limits).T)
                    trials.append((cost(values, True), values))
        start = min(trials, key=lambda pair: pair[0])[1]
        found = minimize(cost, start, (True,), "L-BFGS-B", bounds=limits, options={"maxiter": 25})
        # The search saw a part of the data; what it is worth there is worth more on all of it.
        if plain.fun - found.fun > _WORTH:
            best = of(found.x, True)
    return _balanced(system.without_columns(), best, segments, least)


def _balanced(system: Linear, noise: Noise, segments: Segments, least: Array) -> Noise:
    """Channels' own sizes, from the variance of their innovations; and outliers given less weight."""
    for _ in range(2):
        found = innovations(system, noise.covariances(segments.interval))
        there = np.isfinite(system.r)
        size = np.array(
            [np.sqrt(np.mean(np.minimum(found.e[..., c][there[..., c]] ** 2, CLIP**2)))
             if there[..., c].any() else 1.0 for c in range(there.shape[2])]
        )  # fmt: skip
        # Innovations of observations that say little beyond process force need no other noise.
        factor = np.clip(size, 0.5, 2.0)
        excess = np.abs(found.e) / (CLIP * np.maximum(size, 1e-12))
        noise = replace(
            noise,
            white=np.maximum(noise.white * factor, least),
            coloured=noise.coloured * factor,
            weight=noise.weight * np.maximum(1.0, np.where(there, excess, 1.0)) ** 2,
        )
    return noise
