"""Statistics of a channel that need no model: sampling, quantisation, white noise, runs.

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
_MIN_SAMPLES, _BULK = 20, 4.0  # samples that a measure of spread needs; sds beyond which values are outliers
# Steps: numbers of one grid are multiples of it, and the numbers of a text file err in their last digit.
_EQUAL, _ON_GRID, _MIN_ON_GRID, _MIN_STEPS = 1e-9, 0.1, 0.95, 3
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
    """Regularity of sampling.

    Attributes:
        interval_s: median interval; NaN where no episode has two samples.
        jitter: standard deviation of intervals that lack no sample, in median intervals.
        missing: share of samples that are missing, as far as gaps show.
        longest_gap_s: longest interval that lacks a sample; 0 without one.
    """

    interval_s: float
    jitter: float
    missing: float
    longest_gap_s: float


def sampling(times: Sequence[Array]) -> Sampling:
    """Regularity of the samples of all episodes."""
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


def quantisation_step(x: Array) -> float:
    """Quantisation step of a channel; NaN where its values are not quantised.

    Differences of neighbouring distinct values are small multiples of the step if the values are quantised.
    """
    distinct = np.unique(x)
    differences = np.diff(distinct)
    differences = differences[differences > _EQUAL * max(float(np.ptp(x)), np.finfo(float).tiny)]
    if len(differences) < _MIN_STEPS:
        return float("nan")
    step = float(differences.min())
    near = differences[differences < _FAR_STEPS * step]
    step = float(near.sum() / np.rint(near / step).sum())
    whole = differences / step
    # Where most values occur only once, small differences are rare, and large ones carry no information.
    informative = whole < _FAR_STEPS
    on_grid = np.abs(whole[informative] - np.rint(whole[informative])) < _ON_GRID
    if informative.mean() < 0.5 or on_grid.mean() < _MIN_ON_GRID:
        return float("nan")
    return step


def residuals(t: Array, x: Array) -> Array:
    """Residual of each sample from the cubic through its two neighbours on either side.

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
    """Root mean square about 0 of all values except outliers.

    The median absolute value, which defines the outliers, is itself a poor estimate of the sd: for rounding
    errors, which are uniform over a step, it is a quarter too large.

    Args:
        values: (n,).
        least: lower bound of the sd that defines outliers.

    Returns:
        NaN for too few values.
    """
    if len(values) < _MIN_SAMPLES:
        return float("nan")
    most = _BULK * max(MAD_TO_SD * float(np.median(np.abs(values))), least)
    bulk = values[np.abs(values) <= most]
    return float(np.sqrt(np.mean(bulk**2)))


def white_noise(series: Sequence[Series], step: float) -> float:
    """Standard deviation of a channel's white noise, at least that of quantisation.

    Args:
        series: of the channel.
        step: number_step of its values.

    Returns:
        In the channel's unit; NaN where there are too few samples.
    """
    rounding = 0.0 if np.isnan(step) else step / np.sqrt(12)
    return max(robust_sd(np.concatenate([residuals(one.t, one.x) for one in series]), rounding), rounding)


@dataclass(frozen=True)
class ChannelStatistics:
    """Statistics of a channel.

    Attributes:
        name: of the channel.
        channel: its meaning.
        series: its samples by episode.
        step: number_step of them.
        noise: white_noise of them.
        sampling: regularity of its sampling.
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
        """Quantisation step; 0 where the values are not quantised."""
        return float(np.nan_to_num(self.step))


def channel_statistics(recording: SignalRecording, name: str) -> ChannelStatistics:
    """Compute the statistics of a channel."""
    series = series_of(recording, name)
    step = quantisation_step(np.concatenate([one.x for one in series]))
    return ChannelStatistics(
        name=name,
        channel=recording.channels[name],
        series=series,
        step=step,
        noise=white_noise(series, step),
        sampling=sampling([one.t for one in series]),
    )


def all_channel_statistics(recording: SignalRecording) -> dict[str, ChannelStatistics]:
    """Name -> statistics, for every channel."""
    return {name: channel_statistics(recording, name) for name in recording.channels}


def noise_sd(recording: SignalRecording, name: str) -> float:
    """Standard deviation of a channel's white noise: from the recording if given, else estimated."""
    given = recording.channels[name].noise
    return channel_statistics(recording, name).noise if given is None else given


def runs(x: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last sample of each stretch of equal values, in order."""
    changes = np.flatnonzero(np.diff(x) != 0)
    return np.concatenate([[0], changes + 1]), np.concatenate([changes, [len(x) - 1]])
