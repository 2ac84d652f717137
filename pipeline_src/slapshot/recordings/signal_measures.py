"""What can be measured of a channel without a model: sampling, steps of its numbers, white noise, runs.

Samples of one episode are times t (n,) in s, increasing, and values x (n,), none of them missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.recordings.channels import Channel
from slapshot.recordings.signals import SignalRecording

_GAP, _UNEVEN_GAP = (
    1.5,
    4.0,
)  # intervals and, beyond the usual one, sds of an uneven clock: longer lacks a sample
MAD_TO_SD = 1.4826  # of a normal distribution
_FEWEST, _BULK = 20, 4.0  # samples that a measure of spread needs; sds within which all but odd ones lie
# Steps: numbers of one grid are multiples of it, and the numbers of a text file err in their last digit.
_SAME, _ON_GRID, _MOST_ON_GRID, _FEWEST_STEPS = 1e-9, 0.1, 0.95, 3
_FAR_STEPS = 20


class Series(NamedTuple):
    """Samples of a channel in one episode that are not missing."""

    episode: int
    t: Array
    x: Array


def series_of(recording: SignalRecording, name: str) -> list[Series]:
    """The samples of a channel, episode by episode."""
    table = recording.signals[recording.channels[name].clock]
    seen = table.loc[table[name].notna(), ["episode", "t", name]]
    return [
        Series(int(rows["episode"].iloc[0]), rows["t"].to_numpy(), rows[name].to_numpy())
        for _, rows in seen.groupby("episode")
    ]


@dataclass(frozen=True)
class Sampling:
    """How regularly something was sampled.

    Attributes:
        interval_s: median interval; NaN where no episode has two samples.
        jitter: standard deviation of intervals that lack no sample, in median intervals.
        missing: share of samples that are missing, as far as gaps between others tell.
        longest_gap_s: longest interval that lacks a sample; 0 without one.
    """

    interval_s: float
    jitter: float
    missing: float
    longest_gap_s: float


def sampling(times: Sequence[Array]) -> Sampling:
    """How regularly samples follow each other in episodes."""
    intervals = np.concatenate([np.diff(t) for t in times])
    if not len(intervals):
        return Sampling(float("nan"), float("nan"), 0.0, 0.0)
    typical = float(np.median(intervals))
    whole = intervals / typical
    spread = MAD_TO_SD * float(np.median(np.abs(whole - 1)))
    gaps = whole > max(_GAP, 1 + _UNEVEN_GAP * spread)
    lost = float((np.rint(whole[gaps]) - 1).sum())
    return Sampling(
        interval_s=typical,
        jitter=float(whole[~gaps].std()),
        missing=lost / (lost + sum(map(len, times))),
        longest_gap_s=float(intervals[gaps].max(initial=0.0)),
    )


def number_step(x: Array) -> float:
    """Step between neighbouring numbers of a channel; NaN where its numbers lie on no grid.

    The grid is looked for in the differences of neighbouring distinct values: of numbers on one grid they are
    small multiples of its step.
    """
    distinct = np.unique(x)
    differences = np.diff(distinct)
    differences = differences[differences > _SAME * max(float(np.ptp(x)), np.finfo(float).tiny)]
    if len(differences) < _FEWEST_STEPS:
        return float("nan")
    step = float(differences.min())
    near = differences[differences < _FAR_STEPS * step]
    step = float(near.sum() / np.rint(near / step).sum())
    whole = differences / step
    # Where most values were seen once only, small differences are few: those far apart say nothing of a grid.
    tells = whole < _FAR_STEPS
    on_grid = np.abs(whole[tells] - np.rint(whole[tells])) < _ON_GRID
    if tells.mean() < 0.5 or on_grid.mean() < _MOST_ON_GRID:
        return float("nan")
    return step


def residuals(t: Array, x: Array) -> Array:
    """What each sample differs from the cubic through its two neighbours on either side.

    The differences are scaled so that white noise keeps its standard deviation: with the cubic's weights w_j
    of the neighbours, r_i = (x_i - sum_j w_j x_j) / sqrt(1 + sum_j w_j^2). Times need not be regular.

    Returns:
        (n - 4,), empty with fewer than five samples.
    """
    if len(t) < 5:
        return np.empty(0)
    moments = np.stack([t[:-4], t[1:-3], t[3:-1], t[4:]])  # (4, n - 4)
    values = np.stack([x[:-4], x[1:-3], x[3:-1], x[4:]])
    middle = t[2:-2]
    weights = np.ones_like(moments)  # Lagrange's
    for j in range(4):
        for k in range(4):
            if k != j:
                weights[j] *= (middle - moments[k]) / (moments[j] - moments[k])
    return (x[2:-2] - (weights * values).sum(axis=0)) / np.sqrt(1 + (weights**2).sum(axis=0))


def robust_sd(values: Array, least: float = 0.0) -> float:
    """Root mean square of all values but those that stand out, about 0.

    The median absolute value, from which those are told, is itself no good sd: of rounding errors, which are
    even over a step, it would make a fourth too much.

    Args:
        values: (n,).
        least: size of the sd by which values are told to stand out, at least.

    Returns:
        NaN of too few values.
    """
    if len(values) < _FEWEST:
        return float("nan")
    most = _BULK * max(MAD_TO_SD * float(np.median(np.abs(values))), least)
    bulk = values[np.abs(values) <= most]
    return float(np.sqrt(np.mean(bulk**2)))


def white_noise(series: Sequence[Series], step: float) -> float:
    """Standard deviation of a channel's white noise, that of rounding to its step at least.

    Args:
        series: of the channel.
        step: number_step of its values.

    Returns:
        In the channel's unit; NaN where there are too few samples.
    """
    rounding = 0.0 if np.isnan(step) else step / np.sqrt(12)
    return max(robust_sd(np.concatenate([residuals(one.t, one.x) for one in series]), rounding), rounding)


@dataclass(frozen=True)
class Measured:
    """A channel and what was measured of it.

    Attributes:
        name: of the channel.
        channel: its meaning.
        series: its samples by episode.
        step: number_step of them.
        noise: white_noise of them.
        sampling: how regularly they follow each other.
    """

    name: str
    channel: Channel
    series: list[Series]
    step: float
    noise: float
    sampling: Sampling

    @property
    def samples(self) -> Array:
        """(n,) its samples of all episodes."""
        return np.concatenate([one.x for one in self.series])

    @property
    def grid(self) -> float:
        """Step of its numbers; 0 where they lie on no grid."""
        return float(np.nan_to_num(self.step))


def measure(recording: SignalRecording, name: str) -> Measured:
    """Measure a channel of a recording."""
    series = series_of(recording, name)
    step = number_step(np.concatenate([one.x for one in series]))
    return Measured(
        name=name,
        channel=recording.channels[name],
        series=series,
        step=step,
        noise=white_noise(series, step),
        sampling=sampling([one.t for one in series]),
    )


def measure_all(recording: SignalRecording) -> dict[str, Measured]:
    """Name -> measure, of every channel."""
    return {name: measure(recording, name) for name in recording.channels}


def noise_sd(recording: SignalRecording, name: str) -> float:
    """Standard deviation of a channel's white noise: as the recording says it, else as its samples do."""
    given = recording.channels[name].noise
    return measure(recording, name).noise if given is None else given


def runs(x: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last sample of each stretch of equal values, in order."""
    changes = np.flatnonzero(np.diff(x) != 0)
    return np.concatenate([[0], changes + 1]), np.concatenate([changes, [len(x) - 1]])
