"""Quality warnings about the samples of one channel: `sample_warnings`."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.recordings.quality_warning import QualityWarning, WarningKind
from slapshot.recordings.signal_statistics import ChannelStatistics, Series, residuals, runs

Mask = NDArray[np.bool_]

_LONG_RUN, _AROUND = (
    5,
    10,
)  # samples, and factor on the usual length of runs of equal values; runs that define the usual one
_CUT_RUN = 3  # samples that are equal only if cut off, where numbers lie on no grid
_FAR = 3.0  # times the usual change between runs
_MAX_EQUAL, _MIN_MOVING, _REACH = 0.15, 50, 5  # share, samples, and samples on either side
_RECURS = 1.1  # times that a number comes again, on average, where numbers lie on some grid
STANDS_OUT, STEPS = 8.0, 4.0  # times the noise, and steps of the numbers
_AGREE, _DELAYED = 0.5, 0.1  # of an outlier's height; intervals by which times may err
_OF_CUBIC = 1.394  # sd of what a cubic through four neighbours of a regular series misses of white noise
_MIN_SATURATED, _MAX_SET_POINTS, _MIN_LIMIT = 0.002, 10, 0.5  # share of samples, numbers, of the largest size
_FAST = 3.0  # steps of the numbers with which a channel that is cut off reaches its end
_OTHER_NOISE = 3.0  # times
_RANGE = 2**16  # of numbers of 16 bits


def sample_warnings(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Quality warnings about the samples of a channel."""
    if np.ptp(measured.samples) == 0:
        yield _constant(measured)
        return
    yield from _unsigned(measured)
    yield from _saturated(measured)
    if measured.channel.role == "control":
        return  # a command may stand still, jump and wrap
    stuck = [stuck_samples(one, measured.grid) for one in measured.series]
    if any(mask.any() for mask in stuck):
        yield of_samples(
            measured,
            "stuck_samples",
            stuck,
            f"{measured.name} stands still {sum(_stretches(mask) for mask in stuck)} times, "
            f"{sum(int(mask.sum()) for mask in stuck)} samples in total, and then jumps to the expected "
            "value",
            "sensor or bus stopped meanwhile: exclude these samples, or they are mistaken for friction",
        )
    yield from _repeated(measured, stuck)
    yield from _outliers(measured)
    yield from _other_noise(measured)


def of_samples(
    measured: ChannelStatistics, kind: WarningKind, masks: Sequence[Mask], what: str, why: str
) -> QualityWarning:
    """A warning for the episodes in which a mask is true anywhere."""
    where = tuple(one.episode for one, mask in zip(measured.series, masks, strict=True) if mask.any())
    return QualityWarning(kind, what, where if len(measured.series) > 1 else (), why, "episode")


def _constant(measured: ChannelStatistics) -> QualityWarning:
    value = f"{measured.samples[0]:g} {measured.channel.unit}"
    if measured.channel.role == "control":
        return QualityWarning(
            "constant_control",
            f"control {measured.name} never changes from {value}",
            (),
            "neither its gain nor its delay can be identified from a constant",
            "episode",
        )
    return QualityWarning(
        "constant_channel",
        f"{measured.name} reads {value} in all {len(measured.samples)} samples",
        (),
        "the sensor is not connected, or the joint is locked: the channel carries no information",
        "episode",
    )


def _unsigned(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Negative numbers of 16 bits that were read without their sign: far above all others.

    None lies in the middle half of the range, and neighbours jump across it.
    """
    if not measured.grid > 0 or measured.samples.min() * measured.samples.max() < 0:
        return
    counts = np.rint(np.abs(measured.samples) / measured.grid)
    negative = counts > 0.75 * _RANGE
    jumps = any(np.any(np.abs(np.diff(one.x)) > 0.75 * _RANGE * measured.grid) for one in measured.series)
    if jumps and counts.max() < _RANGE and np.all(negative | (counts < 0.25 * _RANGE)):
        yield QualityWarning(
            "unsigned",
            f"{int(negative.sum())} of {len(counts)} samples of {measured.name} are just below "
            f"{_RANGE * measured.grid:.6g} {measured.channel.unit}, 2^16 steps, and none near half of that",
            (),
            "they look like negative numbers of 16 bits that were read without their sign: subtract 2^16 "
            "steps from these",
            "episode",
        )


def _saturated(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Runs at the largest or smallest value of a channel, entered with a jump."""
    values = measured.samples
    if len(np.unique(values)) <= _MAX_SET_POINTS:
        return  # switches between a few set points
    for end, word in ((float(values.max()), "largest"), (float(values.min()), "smallest")):
        if abs(end) < _MIN_LIMIT * float(np.abs(values).max()):
            continue
        masks = [_cut_off(one.x, end, measured.grid) for one in measured.series]
        share = sum(int(mask.sum()) for mask in masks) / len(values)
        if share >= _MIN_SATURATED:
            yield of_samples(
                measured,
                "saturated",
                masks,
                f"{share:.1%} of the samples of {measured.name} sit at its {word} value, {end:.4g} "
                f"{measured.channel.unit}",
                "it saturates there: the range of the sensor is exceeded, or a limit acted that must be "
                "modelled",
            )


def _cut_off(x: Array, end: float, grid: float) -> Mask:
    """(n,) mask of long runs at `end` that were entered or left with a jump of several quantisation steps.

    A smooth signal approaches its extremum slowly, in single quantisation steps.
    """
    mask = np.zeros(len(x), dtype=bool)
    firsts, lasts = runs(x)
    long = (np.abs(x[firsts] - end) <= grid / 2) & (lasts - firsts + 1 >= (_LONG_RUN if grid else _CUT_RUN))
    for first, last in zip(firsts[long], lasts[long], strict=True):
        beside = [abs(x[i] - end) for i in (first - 1, last + 1) if 0 <= i < len(x)]
        if max(beside, default=0.0) >= _FAST * grid:
            mask[first : last + 1] = True
    return mask


def stuck_samples(one: Series, grid: float) -> Mask:
    """(n,) mask of runs that last much longer than those around them and end with a large jump."""
    mask = np.zeros(len(one.x), dtype=bool)
    firsts, lasts = runs(one.x)
    lengths, changes = lasts - firsts + 1, np.abs(np.diff(one.x[firsts]))
    for k in np.flatnonzero(lengths[:-1] > _LONG_RUN):
        near = slice(max(0, k - _AROUND), k + _AROUND + 1)
        usual_length = float(np.median(lengths[near]))
        usual_change = float(np.median(changes[near]))
        if lengths[k] >= _LONG_RUN * usual_length and changes[k] >= max(
            _LONG_RUN * grid, _FAR * usual_change
        ):
            mask[firsts[k] + 1 : lasts[k] + 1] = True
    return mask


def _stretches(mask: Mask) -> int:
    return int(np.diff(mask.astype(int), prepend=0).clip(min=0).sum())


def _repeated(measured: ChannelStatistics, stuck: Sequence[Mask]) -> Iterator[QualityWarning]:
    """Samples that repeat their predecessor while the channel changes by more than its resolution.

    Of two readings with normal noise of sd s, rounded to steps q << s, a share q / (2 s sqrt(pi)) is equal.
    """
    values = measured.samples
    changes = sum(len(runs(one.x)[0]) for one in measured.series)
    if not measured.grid and changes > _RECURS * len(np.unique(values)):
        return  # unknown quantisation: equal values may be neighbours
    same, moving = 0, 0
    for one, mask in zip(measured.series, stuck, strict=True):
        if len(one.x) > 2 * _REACH:
            slope = np.abs(one.x[2 * _REACH :] - one.x[: -2 * _REACH]) / (2 * _REACH)
            moves = (slope > 2 * measured.grid) & ~mask[_REACH:-_REACH]
            moving += int(moves.sum())
            same += int((moves & (np.diff(one.x) == 0)[_REACH - 1 : -_REACH]).sum())
    chance = measured.grid / (2 * np.sqrt(np.pi) * measured.noise) if measured.noise > 0 else 0.0
    if moving >= _MIN_MOVING and same / moving > _MAX_EQUAL + chance:
        rate = (1 - same / moving) / measured.sampling.interval_s
        yield QualityWarning(
            "repeated_samples",
            f"{same / moving:.0%} of the samples of {measured.name} repeat their predecessor while it "
            f"changes, as if it were read {rate:.3g} times a second",
            (),
            "rows are written more often than the sensor is read, so values are old: give it a clock",
            "episode",
        )


def _outliers(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Single samples far from neighbours that are consistent with each other."""
    masks = []
    for one in measured.series:
        mask = np.zeros(len(one.x), dtype=bool)
        if len(one.x) > 4:
            height, spread, late = _above_line(one)
            least = np.maximum(max(STANDS_OUT * measured.noise, STEPS * measured.grid), late)
            bends = np.abs(residuals(one.t, one.x)) < least / _OF_CUBIC  # and is no outlier
            mask[2:-2] = (height > least) & (spread < _AGREE * height) & ~bends
        masks.append(mask)
    count = sum(int(mask.sum()) for mask in masks)
    if count:
        yield of_samples(
            measured,
            "outliers",
            masks,
            f"{count} of {len(measured.samples)} samples of {measured.name} are outliers",
            f"readings or times off by {STANDS_OUT:g} times the noise; leave cells blank that are wrong",
        )


def _above_line(one: Series) -> tuple[Array, Array, Array]:
    """Distance of each sample from the line through its four neighbours.

    Returns:
        (n - 4,) distance from the line, spread of the neighbours about it, and the line's change in a tenth
        of an interval, which is the tolerance for timing errors.
    """
    t, x = (np.stack([part[:-4], part[1:-3], part[3:-1], part[4:]]) for part in (one.t, one.x))  # (4, n - 4)
    middle, since = x.mean(axis=0), t - t.mean(axis=0)
    slope = (since * x).sum(axis=0) / (since**2).sum(axis=0)
    height = one.x[2:-2] - middle - slope * (one.t[2:-2] - t.mean(axis=0))
    return np.abs(height), np.ptp(x - slope * since, axis=0), np.abs(slope) * np.ptp(t, axis=0) / 4 * _DELAYED


def _other_noise(measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """Noise that differs from the value in the recording."""
    given = measured.channel.noise
    if given is None or np.isnan(measured.noise) or measured.noise == 0:
        return
    if not 1 / _OTHER_NOISE < given / measured.noise < _OTHER_NOISE:
        yield QualityWarning(
            "noise_differs",
            f"the noise of {measured.name} is said to be {given:.2g} {measured.channel.unit}, but samples "
            f"scatter by {measured.noise:.2g}",
            (),
            "residuals are weighted by it: with too small a noise level everything becomes significant",
            "episode",
        )
