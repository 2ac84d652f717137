"""Observation noise and process force, fitted by likelihood.

Each channel has white noise (never less than its quantisation) and coloured noise, an Ornstein-Uhlenbeck
process; both channels of one quantity share the ratio of the two and the correlation time. What the model
leaves out acts as a white process force, in shares of the torque that moves each joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from slapshot.diagnosis.filter import Covariances, Innovations, Linear, innovations
from slapshot.diagnosis.inference.scoring import Evaluation, maximise
from slapshot.diagnosis.segments import Segments

Array = NDArray[np.float64]

HELD_S = 0.01  # process force is told as the standard deviation of a force held so long
LARGEST_LAW_ERROR = 0.15  # rms share of a law
TYPICAL_LAW_ERROR = 0.05  # of empirical laws, before any of them is known
CLIP = 4.0  # standard deviations beyond which an observation counts as an outlier
_NO_JITTER, _USUAL_JITTER = 1e-4, 0.02  # of the interval
_WORTH = 4.0  # nats by which coloured noise must raise the likelihood: twice its two parameters
_SEARCH_SEGMENTS = 8
_SEARCH_OBSERVATIONS = 6000  # which tell noise to a per cent


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
        law_error: size of the errors of the nominal model's laws, as a share.
        added_error: the same of laws that a hypothesis adds.
        weight: (S, L, ny) factor on the white variance; more than 1 for outliers.
        jitter_s: standard deviation of the times at which samples are really taken.
        rate: (S, L, ny) derivative by time of what is observed, by which jitter becomes noise; None for none.
        clock: (ny,) index of the clock of each channel; those of one share their jitter.
    """

    white: Array
    coloured: Array
    correlation_s: Array
    force: float
    torque: Array
    initial: Array
    weight: Array
    law_error: float = 1e-4
    added_error: float = TYPICAL_LAW_ERROR
    jitter_s: float = 0.0
    rate: Array | None = None
    clock: NDArray[np.intp] | None = None

    @property
    def variance(self) -> Array:
        """(S, L, ny) of what is white: noise of the channel, and of the time."""
        own = self.weight * self.white**2
        return own if self._shared is None else own + np.sum(self._shared**2, axis=-1)

    @property
    def _shared(self) -> Array | None:
        """(S, L, ny, clocks) what a clock's jitter of unit size does to each channel."""
        if self.rate is None or not self.jitter_s:
            return None
        clock = np.zeros(self.rate.shape[-1], int) if self.clock is None else self.clock
        of = (clock[:, None] == np.unique(clock)).astype(float)
        return self.jitter_s * self.rate[..., None] * of

    def select(self, segments: NDArray[np.intp]) -> "Noise":
        """That of some segments."""
        rate = None if self.rate is None else self.rate[segments]
        return replace(self, weight=self.weight[segments], rate=rate)

    def elsewhere(self, rate: Array) -> "Noise":
        """The same for other segments, of which rates are known, without outliers."""
        return replace(self, weight=np.ones_like(rate), rate=rate)

    def covariances(self, interval: float) -> Covariances:
        """What the filter takes."""
        return Covariances(
            self.initial,
            (self.force * self.torque) ** 2 * (HELD_S / interval),
            self.weight * self.white**2,
            self.coloured**2,
            np.exp(-interval / self.correlation_s),
            self._shared,
        )


def log_likelihood(found: Innovations) -> float:
    """Of all observations, without constants, at columns' values 0."""
    return float(-0.5 * (np.sum(found.e**2) + found.logdet.sum()))


def marginal_likelihood(found: Innovations, prior_sd: Array) -> float:
    """The same with the columns' values integrated over N(0, prior_sd²)."""
    z = found.Z.reshape(found.e.size, -1) * prior_sd
    b = z.T @ found.e.reshape(-1)
    factor = np.linalg.cholesky(np.eye(len(b)) + z.T @ z)
    half = np.linalg.solve(factor, b)
    return float(log_likelihood(found) + 0.5 * half @ half - np.log(np.diag(factor)).sum())


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


NOMINAL, ADDED = 1, 2


@dataclass(frozen=True)
class Prior:
    """Priors of a system's columns.

    Attributes:
        sd: (p,) standard deviations.
        law_error: (p,) `NOMINAL` or `ADDED` for errors of such laws, whose sd is in shares of their common
            size; 0 for other columns.
    """

    sd: Array
    law_error: NDArray[np.intp]

    def at(self, noise: Noise) -> Array:
        """(p,) standard deviations under a noise."""
        size = np.where(self.law_error == NOMINAL, noise.law_error, 1.0)
        return self.sd * np.where(self.law_error == ADDED, noise.added_error, size)


def fit_noise(
    system: Linear,
    prior: Prior,
    noise: Noise,
    segments: Segments,
    kinds: Sequence[str],
    *,
    near: bool = False,
) -> Noise:
    """Noise of the highest likelihood, all columns being integrated out.

    What any column explains is no noise: so the columns should be those of everything that might be there.

    Args:
        system: linearised.
        prior: of its columns.
        noise: where the search begins.
        segments: data.
        kinds: quantity of each channel; those of one kind share ratio and correlation time of coloured noise.
        near: whether the noise was fitted before to a system much like this one, so that one start suffices.
    """
    S, L = segments.shape
    noise = replace(noise, weight=np.ones_like(noise.weight))
    enough = _SEARCH_OBSERVATIONS // (L * len(kinds))
    some = np.unique(np.linspace(0, S - 1, max(_SEARCH_SEGMENTS, min(S, enough))).astype(int))
    part, searched = system.select(some), noise.select(some)
    groups = sorted(set(kinds))
    member = np.array([groups.index(kind) for kind in kinds])
    first = np.array([kinds.index(group) for group in groups])
    least = np.array([quantisation(segments.y[..., c]) / np.sqrt(12) for c in range(len(kinds))])
    count = len(groups)

    # Values: logarithms of force, of law errors of both kinds and of jitter; then for each kind of channel of
    # a factor on white noise, of the ratio of coloured noise to it, and of its time.
    def of(values: Array, noise: Noise = noise) -> Noise:
        white = np.maximum(noise.white * np.exp(values[4 : 4 + count])[member], least)
        found = replace(
            noise, force=float(np.exp(values[0])), law_error=float(np.exp(values[1])),
            added_error=float(np.exp(values[2])), jitter_s=float(np.exp(values[3])), white=white,
            coloured=0 * white,
        )  # fmt: skip
        if len(values) == 4 + count:
            return found
        ratio, time = np.exp(values[4 + count :]).reshape(2, count)
        return replace(found, coloured=white * ratio[member], correlation_s=time[member])

    def evaluate(values: Array) -> Evaluation:
        candidate = of(values, searched)
        found = innovations(part, candidate.covariances(segments.interval))
        return _evaluation(found, prior.at(candidate), prior.law_error)

    zero = np.zeros(count)
    # Sizes of which no column tells stay what they were.
    law_limits = [
        (np.log(1e-4), np.log(LARGEST_LAW_ERROR)) if np.any(prior.law_error == kind) else (np.log(size),) * 2
        for kind, size in ((NOMINAL, noise.law_error), (ADDED, noise.added_error))
    ]
    longest = max(2 * segments.interval, L * segments.interval / 2)

    def likeliest(jitter: float, jitters: tuple[float, float]) -> Noise:
        """From a jitter, and within limits of it, in s."""
        limits = [(np.log(1e-6), np.log(1e2)), *law_limits, tuple(np.log(jitters)), *[(-7.0, 7.0)] * count]
        forces = sorted({1e-5, 1e-3, 1e-2, 1e-1, noise.force})
        begins = [
            np.log([f, law, noise.added_error, jitter, *np.ones(count)])
            for f in forces
            for law in (1e-3, 0.05)
        ]
        now = np.log([noise.force, noise.law_error, noise.added_error, jitter])
        if near:
            begins = [np.concatenate([now, zero])]
        plain, values = maximise(evaluate, begins, limits)
        limits += [(np.log(0.05), np.log(30.0))] * count
        limits += [(np.log(segments.interval), np.log(longest))] * count
        begins = [
            np.concatenate([[force], values[1:4], values[4:] - 0.5 * np.log1p(ratio**2),
                            zero + np.log(ratio), zero + np.log(time)])
            for ratio in (0.5, 2.0, 10.0)
            for time in (4 * segments.interval, longest / 3)
            for force in ((values[0], np.log(1e-4)) if ratio == 2.0 else (values[0],))
        ]  # fmt: skip
        if near and noise.coloured.any():
            ratio = np.maximum(noise.coloured, 1e-12) / noise.white
            own = np.concatenate([zero, np.log(ratio[first]), np.log(noise.correlation_s[first])])
            begins = [np.concatenate([now, own])]
        coloured, others = maximise(evaluate, begins, limits)
        return _balanced(system, prior, of(others if coloured - plain > _WORTH else values), segments, least)

    def value(found: Noise) -> float:
        own = found.select(some)
        seen = innovations(part, own.covariances(segments.interval))
        return _evaluation(seen, prior.at(own), prior.law_error).value

    none = _NO_JITTER * segments.interval
    if noise.rate is None or (near and not noise.jitter_s):
        return replace(likeliest(none, (none, none)), jitter_s=0.0)
    limits = none, segments.interval / 2
    if near:
        return likeliest(noise.jitter_s, limits)
    # Outliers pass for jitter until they are given less weight.
    without = replace(likeliest(none, (none, none)), jitter_s=0.0)
    jittery = likeliest(_USUAL_JITTER * segments.interval, limits)
    return jittery if value(jittery) > value(without) + _WORTH else without


def _evaluation(found: Innovations, prior_sd: Array, law_error: NDArray[np.intp]) -> Evaluation:
    """Marginal likelihood of innovations, and what its information is made of."""
    there = found.e != 0
    z = found.Z.reshape(found.e.size, -1) * prior_sd
    gram, b = z.T @ z, z.T @ found.e.reshape(-1)
    if not np.all(np.isfinite(gram)):
        return Evaluation(-np.inf, found.e[there], np.log(found.variance[there]))
    factor = cho_factor(np.eye(len(b)) + gram, lower=True)
    values = cho_solve(factor, b)
    value = log_likelihood(found) + 0.5 * b @ values - np.log(np.diag(factor[0])).sum()
    e = (found.e.reshape(-1) - z @ values).reshape(found.e.shape)
    # Of the logarithm of the law errors' size: half the trace of the squared relative covariance.
    information = {}
    for kind in (NOMINAL, ADDED):
        law = law_error == kind
        own = gram[np.ix_(law, law)] - gram[law] @ cho_solve(factor, gram[:, law])
        information[kind] = 2 * float(np.sum(own**2))
    return Evaluation(float(value), e[there], np.log(found.variance[there]), information)


def _balanced(system: Linear, prior: Prior, noise: Noise, segments: Segments, least: Array) -> Noise:
    """Channels' own sizes, from the variance of their innovations; and outliers given less weight."""
    there = np.isfinite(system.r)
    for _ in range(2):
        found = innovations(system, noise.covariances(segments.interval))
        e = unexplained(found, prior.at(noise))
        size = np.array(
            [np.sqrt(np.mean(np.minimum(e[..., c][there[..., c]] ** 2, CLIP**2)))
             if there[..., c].any() else 1.0 for c in range(there.shape[2])]
        )  # fmt: skip
        factor = np.clip(size, 0.5, 2.0)
        excess = np.abs(e) / (CLIP * np.maximum(size, 1e-12))
        noise = replace(
            noise,
            white=np.maximum(noise.white * factor, least),
            coloured=noise.coloured * factor,
            weight=noise.weight * np.maximum(1.0, np.where(there, excess, 1.0)) ** 2,
        )
    return noise


def unexplained(found: Innovations, prior_sd: Array) -> Array:
    """Whitened innovations that no column explains, (S, L, ny)."""
    z = found.Z.reshape(found.e.size, -1) * prior_sd
    values = np.linalg.solve(np.eye(z.shape[1]) + z.T @ z, z.T @ found.e.reshape(-1))
    return found.e - (z @ values).reshape(found.e.shape)
