"""Quality warnings about the samples of one position channel: `position_warnings`."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.sample_quality import STANDS_OUT, STEPS, of_samples, stuck_samples
from slapshot.recordings.signal_statistics import ChannelStatistics, Series, residuals, robust_sd

_FAR, _STAYS = 3.0, 0.5  # times the steps around a jump; of it that is left some samples later
_BESIDE = (-2, -1, 2, 3)  # samples before a jump, and after
_TURN, _TURN_ERR = 2 * np.pi, 0.5
_SMOOTH, _COARSE = -0.5, 1e-3  # correlation of neighbouring residuals (white: -0.8); of the channel's sd
_MAX_JITTER_RATIO, _MIN_JITTER = 3.0, 0.02  # times the noise of slow samples, and of the interval


def position_warnings(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Quality warnings specific to an observed position."""
    if measured.channel.role == "observation" and measured.channel.quantity == "position":
        yield from _jumps(measured)
        yield from _sampling_warnings(measured)


def _jumps(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Jumps of a position between samples that its speed before and after does not explain."""
    turns, others = _jump_masks(measured)
    count, other_count = (sum(int(mask.sum()) for mask in masks) for masks in (turns, others))
    if count:
        yield of_samples(
            measured,
            "wraps",
            turns,
            f"{measured.name} jumps by a whole turn, {count} times",
            "the angle wraps: unwrap it (period in a mapping, or numpy.unwrap), because simulated joints "
            "turn on continuously",
        )
    if other_count:
        yield of_samples(
            measured,
            "jumps",
            others,
            f"{measured.name} jumps {other_count} times by more than its speed before and after explains",
            "an encoder slipped, samples were lost, or two recordings were joined: split the episode there",
        )


def _jump_masks(measured: ChannelStatistics) -> tuple[list[NDArray[np.bool_]], list[NDArray[np.bool_]]]:
    """For each series the samples before a jump by a whole turn, and before any other."""
    turns, others = [], []
    for one in measured.series:
        excess = _excess(one, max(STANDS_OUT * measured.noise, STEPS * measured.grid))
        turned = (np.abs(np.abs(excess) - _TURN) < _TURN_ERR) & (measured.channel.unit == "rad")
        turns.append(turned)
        others.append((excess != 0) & ~turned & ~np.append(False, stuck_samples(one, measured.grid)[:-1]))
    return turns, others


def whole_turns(measured: ChannelStatistics) -> int:
    """How often an angle jumps by a whole turn, as one that wraps does."""
    return sum(int(turned.sum()) for turned in _jump_masks(measured)[0])


def _excess(one: Series, least: float) -> Array:
    """Offset of each sample and its successors from the extrapolation of its predecessors.

    Args:
        one: samples.
        least: smallest offset that counts.

    Returns:
        (n,) offset, 0 where there is none.
    """
    found = np.zeros(len(one.x))
    if len(one.x) < 6:
        return found
    interval, change = np.diff(one.t), np.diff(one.x)
    speed = change / interval
    around = np.sort(np.stack([speed[:-4], speed[1:-3], speed[3:-1], speed[4:]]), axis=0)  # (4, n - 5)
    typical = around[1:3].mean(axis=0)
    excess = change[2:-2] - typical * interval[2:-2]
    here = np.arange(2, len(one.x) - 3)
    off = np.stack(
        [one.x[here + k] - one.x[here] - typical * (one.t[here + k] - one.t[here]) for k in _BESIDE]
    )
    after, before = off[-2:] * np.sign(excess), np.abs(off[:2])
    stays = (after > _STAYS * np.abs(excess)).all(axis=0) & (before < _STAYS * np.abs(excess)).all(axis=0)
    fastest = np.abs(around[[0, -1]]).max(axis=0) * interval[2:-2]
    far = np.abs(excess) > np.maximum(least, _FAR * fastest)
    found[here + 1] = np.where(far & stays, excess, 0.0)
    return found


def _sampling_warnings(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Scatter that grows with speed, which indicates timing errors, and sampling that is too coarse."""
    parts = [(residuals(one.t, one.x), *_speed(one)) for one in measured.series if len(one.t) > 4]
    if not parts:
        return
    left, speed, interval = (np.concatenate(part) for part in zip(*parts, strict=True))
    most = 3 * robust_sd(left)  # a stop or an outlier must not dominate
    neighbours = np.stack(
        [
            np.concatenate([np.clip(part[0][rows], -most, most) for part in parts])
            for rows in (slice(None, -1), slice(1, None))
        ]
    )
    # Below it there is only rounding, or a simulation without noise.
    large = robust_sd(left) > max(measured.grid, _COARSE * float(measured.samples.std()))
    if large and np.corrcoef(neighbours)[0, 1] > _SMOOTH:
        yield QualityWarning(
            "coarse_sampling",
            f"{measured.name} is undersampled: the residual of a cubic through its neighbours "
            f"({robust_sd(left):.2g} {measured.channel.unit}) is not noise",
            (),
            "noise cannot be estimated, and motion between samples is not observed: record at a higher rate",
            "episode",
        )
        return
    slow, fast = speed <= np.quantile(speed, 0.5), speed >= np.quantile(speed, 0.9)
    rounding = measured.grid / np.sqrt(12)
    still, moving = (max(robust_sd(left[rows], rounding), rounding) for rows in (slow, fast))
    typical = float(np.median(speed[fast]))
    if moving > _MAX_JITTER_RATIO * still and typical > 0:
        jitter = np.sqrt(moving**2 - still**2) / typical
        if jitter > _MIN_JITTER * float(np.median(interval)):
            yield QualityWarning(
                "moving_noise",
                f"{measured.name} scatters by {moving:.2g} {measured.channel.unit} where it is fast and by "
                f"{still:.2g} where it is slow, as if its times erred by {1000 * jitter:.2g} ms",
                (),
                "noise that grows with speed is a timing error: with equal weights it is mistaken for "
                "physics",
                "episode",
            )


def _speed(one: Series) -> tuple[Array, Array]:
    """(n - 4,) speed about each sample that has two neighbours on either side, and interval there."""
    span = one.t[4:] - one.t[:-4]
    return np.abs(one.x[4:] - one.x[:-4]) / span, span / 4
