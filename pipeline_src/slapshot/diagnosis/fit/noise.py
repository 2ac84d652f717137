"""Observation noise and process force, fitted by likelihood.

Each channel has white noise (never less than its quantisation) and coloured noise, an Ornstein-Uhlenbeck
process; both channels of one quantity share the ratio of the two and the correlation time. Over a session
readings drift, by less than their noise. Unmodelled forces are a white process force, relative to the torque
that moves each joint.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.stats import chi2
from scipy.stats import t as student_t

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Covariances, Innovations, Linear, innovations, leave_one_out
from slapshot.diagnosis.inference.fisher_scoring import Evaluation, maximise
from slapshot.diagnosis.model.segments import Segments

FORCE_HOLD_S = 0.01  # the process force is given as the sd of a force held for this time
LARGEST_LAW_ERROR = 0.15  # rms share of a law
# Drift of readings relative to their noise: initial value, and upper bound.
TYPICAL_DRIFT, LARGEST_DRIFT = 0.1, 1.0
TYPICAL_LAW_ERROR = 0.05  # of empirical laws, initial value
CLIP = 4.0  # standard deviations beyond which an observation is an outlier
_NO_JITTER, _USUAL_JITTER = 1e-4, 0.02  # of the interval
# Growth of noise over a session: errors count up to so many standard deviations; its level of significance,
# fewest episodes, and largest factor.
_BOUNDED_SD, _CHANCE, _FEWEST_EPISODES, _MOST_GROWTH = 2.0, 0.05, 4, 4.0
_MIN_GAIN_NATS = 4.0  # minimum gain of coloured noise: twice its two parameters
_SEARCH_SEGMENTS = 8
_SEARCH_OBSERVATIONS = 6000  # which determine white noise to a per cent, other sizes to about ten
_TOLERANCE, _LOOSE_TOLERANCE = 0.01, 0.5  # tolerances in nats: of the last fit, and before
# Rounds and tolerance with all observations: from the estimate of a subset, one is asymptotically enough (Le
# Cam).
_LAST_ROUNDS, _LAST_TOLERANCE = 2, 0.2
_SIZES = 3  # first values: sizes of columns
_DIRECTIONS = 16  # of a trace, which is then known to some per cent
_RATIOS, _MOST_RATIO = (0.5, 2.0, 10.0), 1e3  # of coloured to white noise
_GOOD_LAW, _NO_FORCE = np.log([1e-3]), np.log([1e-4])
_FORCES = float(np.log(1e-6)), float(np.log(1e2))  # process force, in logarithms of usual torques


@dataclass(frozen=True)
class Noise:
    """Noise of a recording under a model.

    Attributes:
        white: (ny,) standard deviation.
        coloured: (ny,) standard deviation.
        correlation_s: (ny,) correlation time of the coloured part.
        force: process force over `torque`, as the sd of a force held for `HELD_S`.
        torque: (nv,) N m or N, scale of forces.
        initial: (n,) variances of a segment's first state about the trajectory.
        law_error: size of the errors of the nominal model's laws, as a share.
        added_error: the same of laws that a hypothesis adds.
        weight: (S, L, ny) factor on the white variance; more than 1 for outliers.
        growth: (ny,) logarithm of the factor by which noise grows over the session; None for none.
        order: (S,) places of the segments in the session, see `Segments`; None where noise does not grow.
        drift: root mean square of a channel's slow drift over the session, over that of its noise.
        jitter_s: standard deviation of the actual sampling times.
        rate: (S, L, ny) time derivative of the observations, which converts jitter to noise; None for none.
        clock: (ny,) index of the clock of each channel; those of one share their jitter.
        set_aside: (S, L) further process force, as `force`, in windows with enormous pushes; 0 elsewhere,
            None without any.
        push_error: (S, L) process force by which named pushes may differ from constant ones, as `force`; None
            for none.
        control_error: (S, L) process force by which controls act earlier or later than their stamps say, as
            `force`; None for none.
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
    drift: float = TYPICAL_DRIFT
    jitter_s: float = 0.0
    rate: Array | None = None
    clock: NDArray[np.intp] | None = None
    growth: Array | None = None
    order: Array | None = None
    set_aside: Array | None = None
    push_error: Array | None = None
    control_error: Array | None = None

    @property
    def single(self) -> Array:
        """(ny,) standard deviation of a single reading."""
        return np.hypot(self.white, self.coloured)

    def correlation(self, readings: int, interval: float) -> Array:
        """(ny, readings, readings) of successive readings of each channel.

        Args:
            readings: how many.
            interval: s between two.
        """
        lags = np.abs(np.subtract.outer(np.arange(readings), np.arange(readings)))
        share = (self.coloured / self.single)[:, None, None] ** 2
        lasting = np.exp(-lags * interval / self.correlation_s[:, None, None])
        return np.asarray(share * lasting + (1 - share) * np.eye(readings))

    @property
    def variance(self) -> Array:
        """(S, L, ny) white variance: noise of the channel, and timing jitter."""
        own = self.weight * self.usual_variance
        return own if self._shared is None else own + np.sum(self._shared**2, axis=-1)

    @property
    def usual_variance(self) -> Array:
        """(S or 1, 1, ny) white variance of a channel without outliers."""
        return self._squared(self.white)

    @property
    def single_variance(self) -> Array:
        """(S or 1, 1, ny) variance of a single reading without outliers, jitter left out."""
        return self._squared(self.single)

    @property
    def outlying(self) -> Array:
        """(S, L, ny) variance of a reading over that of one that is no outlier, jitter left out."""
        return np.asarray(1 + (self.weight - 1) * (self.white / self.single) ** 2)

    def with_white(self, white: Array) -> "Noise":
        """The noise with other white noise (ny,): outliers keep the variance that they lack."""
        return replace(self, white=white, weight=1 + (self.weight - 1) * (self.white / white) ** 2)

    def _squared(self, size: Array) -> Array:
        level = np.ones((1, len(size))) if self.level is None else self.level
        return np.asarray((size * level)[:, None] ** 2)

    @property
    def level(self) -> Array | None:
        """(S, ny) noise of each segment over that in the middle of the session; None for 1."""
        if self.growth is None or self.order is None:
            return None
        return np.asarray(np.exp(self.growth * self.order[:, None]))

    @property
    def _shared(self) -> Array | None:
        """(S, L, ny, clocks) response of each channel to unit jitter of a clock."""
        if self.rate is None or not self.jitter_s:
            return None
        clock = np.zeros(self.rate.shape[-1], int) if self.clock is None else self.clock
        of = (clock[:, None] == np.unique(clock)).astype(float)
        return self.jitter_s * self.rate[..., None] * of

    def select(self, segments: NDArray[np.intp]) -> "Noise":
        """That of some segments."""
        rate = None if self.rate is None else self.rate[segments]
        set_aside = None if self.set_aside is None else self.set_aside[segments]
        error = None if self.push_error is None else self.push_error[segments]
        late = None if self.control_error is None else self.control_error[segments]
        order = None if self.order is None else self.order[segments]
        return replace(
            self, weight=self.weight[segments], rate=rate, order=order, set_aside=set_aside, push_error=error,
            control_error=late,
        )  # fmt: skip

    def elsewhere(self, rate: Array, order: Array, control_error: Array | None) -> "Noise":
        """The noise of other segments, with their rates and errors of controls; no outliers or pushes."""
        return replace(
            self, weight=np.ones_like(rate), rate=rate, order=order, set_aside=None, push_error=None,
            control_error=control_error,
        )  # fmt: skip

    @property
    def without_set_aside(self) -> "Noise":
        """The noise with one process force in all windows."""
        return replace(self, set_aside=None)

    @property
    def log_prior(self) -> float:
        """Of the sizes of law errors: where forces explain the data equally well, they stay typical."""
        return -0.5 * (self.law_error**2 + self.added_error**2) / TYPICAL_LAW_ERROR**2

    def covariances(self, interval: float) -> Covariances:
        """What the filter takes."""
        all_further = self.set_aside, self.push_error, self.control_error
        further = [of for of in all_further if of is not None]
        inflation = 1 + np.sum(np.square(further), axis=0) / self.force**2 if further else None
        return Covariances(
            self.initial,
            (self.force * self.torque) ** 2 * (FORCE_HOLD_S / interval),
            self.weight * self.usual_variance,
            self.coloured**2,
            np.exp(-interval / self.correlation_s),
            self._shared,
            inflation,
            self.level,
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


def initial_noise(segments: Segments, torque: Array, n: int, position: Array, speed: Array) -> Noise:
    """Initial noise: white noise from third differences of the recorded values.

    Args:
        segments: data.
        torque: (nv,) scale of forces.
        n: length of a change of state.
        position: (nv,) wide standard deviations of a first position about the trajectory.
        speed: (nv,) the same of a velocity.
    """
    white = np.array([_white_noise(channel) for channel in np.moveaxis(segments.y, -1, 0)])
    spread = np.nanstd(segments.y, axis=(0, 1))
    finest = np.maximum(1e-6 * np.nan_to_num(spread), 1e-9)
    # Of a joint that rests for most of the time, most differences are 0.
    white = np.maximum(white, np.maximum(finest, segments.quantisation / np.sqrt(12)))
    initial = np.concatenate([position**2, speed**2, np.ones(n - 2 * len(torque))])
    ny = segments.y.shape[2]
    return Noise(white, np.zeros(ny), np.full(ny, 0.05), 1e-2, torque, initial, np.ones_like(segments.y))


def _white_noise(y: Array) -> float:
    """Standard deviation of a channel, (S, L), from third differences of its samples.

    Those of white noise have 20 times its variance; the median leaves jumps out. A slow clock has samples at
    some nodes only.
    """
    third = np.concatenate([np.diff(row[np.isfinite(row)], n=3) for row in y])
    return float(np.median(np.abs(third))) / 0.6745 / np.sqrt(20) if len(third) else 0.0


# Columns with a common size that is a noise parameter: errors of nominal and of added laws, relative to the
# law, and drift, in standard deviations of the channel's noise.
NOMINAL, ADDED, DRIFT = 1, 2, 3


@dataclass(frozen=True)
class Prior:
    """Priors of a system's columns.

    Attributes:
        sd: (p,) standard deviations; of columns of one of the sizes above, in units of that.
        kind: (p,) `NOMINAL`, `ADDED` or `DRIFT`; 0 for other columns.
        channel: (p,) that drifts; any for other columns.
    """

    sd: Array
    kind: NDArray[np.intp]
    channel: NDArray[np.intp]

    @classmethod
    def of(cls, sd: Array, kind: int = 0, channel: NDArray[np.intp] | None = None) -> "Prior":
        """Priors of columns of one kind."""
        nothing = np.zeros(len(sd), int)
        return cls(sd, nothing + kind, nothing if channel is None else channel)

    def select(self, columns: NDArray[np.bool_]) -> "Prior":
        """Those of some columns."""
        return Prior(self.sd[columns], self.kind[columns], self.channel[columns])

    def and_of(self, other: "Prior") -> "Prior":
        """These, and those of further columns."""
        return Prior(
            np.concatenate([self.sd, other.sd]),
            np.concatenate([self.kind, other.kind]),
            np.concatenate([self.channel, other.channel]),
        )

    def at(self, noise: Noise) -> Array:
        """(p,) standard deviations under a noise."""
        sizes = np.array([1.0, noise.law_error, noise.added_error, noise.drift])[self.kind]
        return self.sd * sizes * np.where(self.kind == DRIFT, noise.single[self.channel], 1.0)


def fit_noise(
    system: Linear,
    prior: Prior,
    noise: Noise,
    segments: Segments,
    kinds: Sequence[str],
    *,
    near: bool = False,
    last: bool = True,
) -> Noise:
    """Maximum likelihood noise, with all columns integrated out.

    The columns should include all candidate effects, so that what they explain is not counted as noise.

    Args:
        system: linearised.
        prior: of its columns.
        noise: initial value; its outliers keep the variance that they lack.
        segments: data.
        kinds: quantity of each channel; those of one kind share ratio and correlation time of coloured noise.
        near: whether the noise was fitted to a similar system before, so that one initial point suffices.
        last: whether all segments are used at the end and jitter is fitted; else it is a first estimate.
    """
    S, L = segments.shape
    some = _search_subset(S, L * len(kinds))
    part = system.select(some)
    groups = sorted(set(kinds))
    member = np.array([groups.index(kind) for kind in kinds])
    first = np.array([kinds.index(group) for group in groups])
    least = segments.quantisation / np.sqrt(12)
    count = len(groups)

    # Values: logarithms of the sizes of law errors of both kinds and of drift, of force and of jitter; then
    # for each kind of channel a factor on white noise, the ratio of coloured noise to it, and its time.
    def of(values: Array, noise: Noise = noise) -> Noise:
        white = np.maximum(noise.white * np.exp(values[5 : 5 + count])[member], least)
        law, added, drift, force, jitter = (float(size) for size in np.exp(values[:5]))
        found = replace(
            noise.with_white(white), force=force, law_error=law, added_error=added, drift=drift,
            jitter_s=jitter, coloured=0 * white,
        )  # fmt: skip
        if len(values) == 5 + count:
            return found
        ratio, time = np.exp(values[5 + count :]).reshape(2, count)
        return replace(found, coloured=white * ratio[member], correlation_s=time[member])

    def likelihood(system: Linear, noise: Noise) -> NoiseLikelihood:
        return NoiseLikelihood(system, prior, lambda values: of(values, noise), segments.interval)

    searched = likelihood(part, noise.select(some))
    every = searched if len(some) == S else likelihood(system, noise)
    zero = np.zeros(count)
    # Sizes without columns are kept fixed.
    size_limits = [
        (np.log(least_size), np.log(largest)) if np.any(prior.kind == kind) else (np.log(size),) * 2
        for kind, size, least_size, largest in (
            (NOMINAL, noise.law_error, 1e-4, LARGEST_LAW_ERROR),
            (ADDED, noise.added_error, 1e-4, LARGEST_LAW_ERROR),
            (DRIFT, noise.drift, 1e-3, LARGEST_DRIFT),
        )
    ]
    longest = max(2 * segments.interval, L * segments.interval / 2)

    def scaled(values: Array) -> Array:
        """Values with white noise scaled so that innovations have unit size."""
        size = np.log(np.sqrt(np.mean(searched(values).e ** 2)))
        return np.concatenate([values[:5], values[5 : 5 + count] + size, values[5 + count :]])

    def maximum_likelihood(
        jitter: float, jitters: tuple[float, float]
    ) -> tuple[Array, list[tuple[float, float]]]:
        """Values for an initial jitter, and their limits, with those of the jitter in s."""
        limits = [*size_limits, _FORCES, tuple(np.log(jitters)), *[(-7.0, 7.0)] * count]
        forces = sorted({1e-5, 1e-3, 1e-2, 1e-1, noise.force})
        initial_points = [
            np.log([law, noise.added_error, noise.drift, f, jitter, *np.ones(count)])
            for f in forces
            for law in (1e-3, 0.05)
        ]
        now = np.log([noise.law_error, noise.added_error, noise.drift, noise.force, jitter])
        if near:
            initial_points = [np.concatenate([now, zero])]
        tolerance = _TOLERANCE if last else _LOOSE_TOLERANCE
        plain, values = maximise(searched, initial_points, limits, tolerance=tolerance)
        limits += [(np.log(0.05), np.log(_MOST_RATIO))] * count
        limits += [(np.log(segments.interval), np.log(longest))] * count
        initial_points = []
        if noise.coloured.any():
            ratio = np.maximum(noise.coloured, 1e-12) / noise.white
            own = np.concatenate([zero, np.log(ratio[first]), np.log(noise.correlation_s[first])])
            initial_points = [np.concatenate([now, own])]
        if not (near and initial_points):
            usual = [
                np.concatenate([values[:5], values[5:] - 0.5 * np.log1p(ratio**2), zero + np.log(ratio),
                                zero + np.log(time)])
                for ratio in _RATIOS for time in (4 * segments.interval, longest / 3)
            ]  # fmt: skip
            # A process force can explain wandering readings too: noise without process force is another,
            # distant optimum.
            quiet = np.concatenate([_GOOD_LAW, values[1:3], _NO_FORCE])
            initial_points += [
                *usual,
                *(scaled(np.concatenate([quiet, initial_point[4:]])) for initial_point in usual),
            ]
        coloured, others = maximise(searched, initial_points, limits, tolerance=tolerance)
        if coloured - plain > _MIN_GAIN_NATS:
            values = others
        return values, limits[: len(values)]

    def reweighted(values: Array) -> Noise:
        return _reweighted(system, prior, of(values), segments, least)

    def final_noise(values: Array, limits: list[tuple[float, float]]) -> Noise:
        """By all segments."""
        if last and len(some) < S:
            _, values = maximise(every, [values], limits, rounds=_LAST_ROUNDS, tolerance=_LAST_TOLERANCE)
        return reweighted(values)

    def value(found: Noise) -> float:
        own = found.select(some)
        return NoiseLikelihood(part, prior, lambda _: own, segments.interval)(np.zeros(0)).value

    none = _NO_JITTER * segments.interval
    if noise.rate is None or not last or (near and not noise.jitter_s):
        return replace(final_noise(*maximum_likelihood(none, (none, none))), jitter_s=0.0)
    limits = none, segments.interval / 2
    if near:
        return final_noise(*maximum_likelihood(noise.jitter_s, limits))
    without = maximum_likelihood(none, (none, none))
    if not prefers_jitter(searched(without[0]), noise.rate[some][np.isfinite(part.r)]):
        return replace(final_noise(*without), jitter_s=0.0)
    # Outliers are mistaken for jitter until they are down-weighted.
    jittery = maximum_likelihood(_USUAL_JITTER * segments.interval, limits)
    if value(reweighted(jittery[0])) > value(replace(reweighted(without[0]), jitter_s=0.0)) + _MIN_GAIN_NATS:
        return final_noise(*jittery)
    return replace(final_noise(*without), jitter_s=0.0)


def fit_process_force(
    system: Linear,
    prior: Prior,
    noise: Noise,
    interval: float,
    largest_law_error: float = LARGEST_LAW_ERROR,
    largest_added_error: float = LARGEST_LAW_ERROR,
) -> Noise:
    """Fit the process force and law errors that a hypothesis leaves, at fixed noise of the readings.

    A missing effect does not change the noise of the readings, but leaves unmodelled forces.

    Args:
        system: linearised.
        prior: of its columns.
        noise: of the readings; where the search begins.
        interval: s between nodes.
        largest_law_error: of the nominal model's laws.
        largest_added_error: of laws that a hypothesis adds.
    """

    def of(values: Array, noise: Noise) -> Noise:
        law, added, force = (float(size) for size in np.exp(values[[0, 1, 3]]))
        return replace(noise, law_error=law, added_error=added, force=force)

    least = np.log(1e-4)
    limits = [
        (least, np.log(most)) if np.any(prior.kind == kind) else (np.log(size),) * 2
        for kind, size, most in (
            (NOMINAL, noise.law_error, largest_law_error),
            (ADDED, noise.added_error, largest_added_error),
        )
    ]
    limits += [(np.log(noise.drift),) * 2, _FORCES]
    now = np.log([noise.law_error, noise.added_error, noise.drift, noise.force])
    small = np.log([1e-3, 1e-2, noise.drift])

    def penalised(segments: NDArray[np.intp]) -> Callable[[Array], Evaluation]:
        whole = len(segments) == len(system.d)
        part, own = (system, noise) if whole else (system.select(segments), noise.select(segments))
        likelihood = NoiseLikelihood(part, prior, lambda values: of(values, own), interval)

        def evaluate(values: Array) -> Evaluation:
            found = likelihood(values)
            share = np.exp(2 * values[:2]) / TYPICAL_LAW_ERROR**2
            with_prior = {index: found.information.get(index, 0.0) + 2 * share[index] for index in (0, 1)}
            more = {**found.information, **with_prior}
            return replace(with_log_prior(found, values), information=more)

        def with_log_prior(found: Evaluation, values: Array) -> Evaluation:
            near = found.near
            return replace(
                found,
                value=found.value + of(values, noise).log_prior,
                near=None if near is None else lambda changed: with_log_prior(near(changed), changed),
            )

        return evaluate

    S, L, ny = system.r.shape
    some = _search_subset(S, L * ny)
    searched = penalised(some)
    forces = (noise.force, 1e-3, 1e-2, 1e-1, 1.0)
    reached = [
        maximise(searched, [np.append(sizes, np.log(force)) for force in forces], limits)
        for sizes in (now[:3], small)
    ]
    _, values = max(reached, key=lambda one: one[0])
    if len(some) < S:
        every = penalised(np.arange(S))
        _, values = maximise(every, [values], limits, rounds=_LAST_ROUNDS, tolerance=_LAST_TOLERANCE)
    return of(values, noise)


def prefers_jitter(found: Evaluation, rate: Array) -> bool:
    """Whether errors are larger where readings change fast, by a score test (Cook, Weisberg 1983).

    Jitter must gain far more than the standard deviation that is asked for here.

    Args:
        found: under a noise without jitter.
        rate: (n,) derivatives in time of the observations.
    """
    share = rate**2 / np.exp(found.log_variance)
    share = share - share.mean()  # white noise was fitted
    return bool(np.sum((found.e**2 - 1) * share) > np.sqrt(2 * np.sum(share**2)))


def _search_subset(segments: int, observations: int) -> NDArray[np.intp]:
    """A subset of segments that determines the noise well enough for a search."""
    count = max(_SEARCH_SEGMENTS, min(segments, _SEARCH_OBSERVATIONS // observations))
    return np.unique(np.linspace(0, segments - 1, count).astype(int))


class NoiseLikelihood:
    """Marginal likelihood of the noise and its Fisher information.

    Args:
        system: linearised.
        prior: of its columns.
        of: the noise that values stand for; the first values are sizes of columns.
        interval: s between nodes.
    """

    def __init__(self, system: Linear, prior: Prior, of: Callable[[Array], Noise], interval: float) -> None:
        self._system, self._prior, self._of, self._interval = system, prior, of, interval
        self._there = np.isfinite(system.r)

    def __call__(self, values: Array) -> Evaluation:
        """At some values."""
        noise = self._of(values)
        found = innovations(self._system, noise.covariances(self._interval))
        z = found.Z.reshape(found.e.size, -1)
        gram, b, sd = z.T @ z, z.T @ found.e.reshape(-1), self._prior.at(noise)
        if not np.all(np.isfinite(gram * np.outer(sd, sd))):
            with np.errstate(invalid="ignore"):  # variances that overflowed
                return Evaluation(-np.inf, found.e[self._there], np.log(found.variance[self._there]))
        here = _Marginal(found, gram, b, sd, self._there)

        def near(changed: Array) -> Evaluation:
            noise = self._of(changed)
            sd = self._prior.at(noise)
            if np.array_equal(changed[_SIZES:], values[_SIZES:]):
                return replace(_Marginal(found, gram, b, sd, self._there).evaluation, near=None)
            return self._near(here, noise)

        information = {}
        for index, kind in enumerate((NOMINAL, ADDED, DRIFT)):
            information[index] = here.information(self._prior.kind == kind)
        return replace(here.evaluation, information=information, near=near)

    def _near(self, here: "_Marginal", noise: Noise) -> Evaluation:
        """Under a noise near that of `here`, to first order in their difference.

        The most likely values of columns may stay (envelope theorem), and of the log determinant of their
        information the derivative is a trace, estimated by random directions (Hutchinson 1990,
        Communications in Statistics 19(2)). So few columns are filtered instead of all.
        """
        columns = here.sd[:, None] * np.column_stack([here.values, here.directions])
        system = self._system.moved(columns[:, 0])
        system = system.with_columns(system.W @ columns[:, 1:], system.psi @ columns[:, 1:])
        found = innovations(system, noise.covariances(self._interval))
        change = log_likelihood(found) - 0.5 * float(np.sum(found.Z**2)) / _DIRECTIONS
        value = here.evaluation.value + change - here.first_order
        return Evaluation(value, found.e[self._there], np.log(found.variance[self._there]))


class _Marginal:
    """Innovations with their columns integrated out.

    Args:
        found: innovations with columns of unit size.
        gram: (p, p) information of the columns.
        b: (p,) their products with the innovations.
        sd: (p,) standard deviations of their values.
        there: (S, L, ny) where something was recorded.
    """

    def __init__(
        self, found: Innovations, gram: Array, b: Array, sd: Array, there: NDArray[np.bool_]
    ) -> None:
        self.found, self.sd, self._there = found, sd, there
        self._gram, self._b = gram * np.outer(sd, sd), b * sd
        self._factor = cho_factor(np.eye(len(b)) + self._gram, lower=True)

    @cached_property
    def values(self) -> Array:
        """(p,) most likely values, in standard deviations."""
        return np.asarray(cho_solve(self._factor, self._b))

    @cached_property
    def rest(self) -> Array:
        """(S, L, ny) what columns do not explain."""
        return np.asarray(self.found.e - self.found.Z @ (self.values * self.sd))

    @cached_property
    def directions(self) -> Array:
        """(p, k) whose outer products have the covariance of the values as their mean."""
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(self.sd), _DIRECTIONS))
        return np.asarray(solve_triangular(self._factor[0], signs, lower=True, trans="T"))

    @cached_property
    def first_order(self) -> float:
        """What `NoiseLikelihood._near` changes, here."""
        trace = float(np.einsum("ik,ij,jk->", self.directions, self._gram, self.directions, optimize=True))
        return log_likelihood(replace(self.found, e=self.rest)) - 0.5 * trace / _DIRECTIONS

    @cached_property
    def evaluation(self) -> Evaluation:
        """The likelihood."""
        value = log_likelihood(self.found) + 0.5 * self._b @ self.values
        value -= np.log(np.diag(self._factor[0])).sum()
        return Evaluation(float(value), self.rest[self._there], np.log(self.found.variance[self._there]))

    def information(self, of: NDArray[np.bool_]) -> float:
        """Of the logarithm of the size of some columns: half the trace of the squared relative covariance."""
        part = self._gram[np.ix_(of, of)] - self._gram[of] @ cho_solve(self._factor, self._gram[:, of])
        return 2 * float(np.sum(part**2))


def _reweighted(system: Linear, prior: Prior, noise: Noise, segments: Segments, least: Array) -> Noise:
    """Rescale each channel from the variance of its innovations, and down-weight outliers.

    Outliers are judged by leave-one-out residuals, which use later observations too.
    """
    there = np.isfinite(system.r)
    largest = np.full(there.shape[2], np.log(_MOST_GROWTH))
    growth = np.zeros_like(largest)
    noise = replace(noise, weight=np.ones_like(noise.weight), growth=growth, order=segments.order)
    for first in (True, False):
        covariances = noise.covariances(segments.interval)
        found = innovations(system, covariances)
        values = posterior_means(found, prior.at(noise))
        e = found.e - found.Z @ values
        size = np.array(
            [np.sqrt(np.mean(np.minimum(e[..., c][there[..., c]] ** 2, CLIP**2)))
             if there[..., c].any() else 1.0 for c in range(there.shape[2])]
        )  # fmt: skip
        factor = np.clip(size, 0.5, 2.0)
        lacking = _lacking_variance(system.moved(values), covariances, size)
        noise = replace(noise, white=noise.white * factor, coloured=noise.coloured * factor)
        before = noise.usual_variance
        step, sure, middle = _growth(np.where(there, e / np.maximum(size, 1e-12), np.nan), segments.order)
        # Noise is never less than the quantisation, at neither end of the session.
        with np.errstate(divide="ignore"):
            most = np.clip(2 * np.log(noise.white / least), 0, largest)
        now = np.clip(np.where(sure if first else growth != 0, growth + step, 0.0), -most, most)
        # At the readings the noise stays as large as it is.
        white = np.maximum(noise.white * np.exp((growth - now) * middle), least)
        coloured = noise.coloured * np.exp((growth - now) * middle)
        growth = now
        noise = replace(noise, white=white, coloured=coloured, growth=growth)
        # What has grown lacks no more.
        lacking = np.maximum(lacking - np.maximum(noise.usual_variance - before, 0.0), 0.0)
        noise = replace(noise, weight=noise.weight + lacking / noise.usual_variance)
    return noise


def _growth(e: Array, order: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """The logarithm of the factor by which noise grows over the session: a step of Fisher scoring.

    Errors of a model come in bursts and fill episodes: how sure the growth is follows from the spread of the
    episodes about it.

    Args:
        e: (S, L, ny) innovations of about unit variance; NaN where there are none.
        order: (S,) places in the session, -0.5 to 0.5; segments of an episode have one.

    Returns:
        (ny,) logarithms, whether they are significant, and the mean places of the readings.
    """
    places, of = np.unique(order, return_inverse=True)
    there = np.isfinite(e)
    square = np.where(there, np.minimum(e**2, _BOUNDED_SD**2), 0.0).sum(1)
    count, total = np.zeros((2, len(places), e.shape[2]))
    np.add.at(count, of, there.sum(1))
    np.add.at(total, of, square)
    every = np.maximum(count.sum(0), 1)
    middle = (places[:, None] * count).sum(0) / every
    along = places[:, None] - middle
    # Of a standard deviation exp(g x), the square of a bounded Gaussian error grows by as much per g x.
    expected = 2 * chi2.cdf(_BOUNDED_SD**2, 3) * along**2 * count
    information = np.maximum(expected.sum(0), 1e-300)
    seen = along * (total - count * total.sum(0) / every)
    growth = seen.sum(0) / information
    known = (count > 0).sum(0)
    free = np.maximum(known - 2, 1)
    sd = np.sqrt(known / free * np.sum((seen - growth * expected) ** 2, axis=0)) / information
    sure = (known >= _FEWEST_EPISODES) & (np.abs(growth) > student_t.isf(_CHANCE / 2, free) * sd)
    return growth, sure, middle


def with_outliers(system: Linear, noise: Noise, interval: float) -> Noise:
    """The noise with outliers down-weighted, judged about the trajectory of a system.

    Args:
        system: with the columns' values moved into it.
        noise: of the data, with a process force that covers all that may act.
        interval: s between nodes.
    """
    one = np.ones(system.r.shape[-1])
    lacking = _lacking_variance(system, noise.covariances(interval), one)
    return replace(noise, weight=noise.weight + lacking / noise.usual_variance)


def _lacking_variance(system: Linear, covariances: Covariances, size: Array) -> Array:
    """(S, L, ny) variance that outliers lack, by residuals in which they take no part themselves.

    Args:
        system: with the columns' values moved into it.
        covariances: of the noise.
        size: (ny,) factor on the standard deviations.
    """
    residual, variance = leave_one_out(system.without_columns(), covariances)
    variance = np.where(np.isfinite(system.r), variance * np.maximum(size, 1e-12) ** 2, 1.0)
    # One standard deviation is left of an outlier: of four, a hundredth of the readings would decide how much
    # of a noise that lasts is white.
    return np.asarray(np.where(residual**2 > CLIP**2 * variance, residual**2 - variance, 0.0))


def posterior_means(found: Innovations, prior_sd: Array) -> Array:
    """(p,) posterior means of the columns' values."""
    z = found.Z.reshape(found.e.size, -1) * prior_sd
    return prior_sd * np.linalg.solve(np.eye(z.shape[1]) + z.T @ z, z.T @ found.e.reshape(-1))
