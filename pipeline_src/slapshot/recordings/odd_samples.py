"""What is odd in the samples of one channel of signals: `odd_samples`."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from slapshot.recordings.finding import Finding, FindingKind
from slapshot.recordings.signal_measures import Measured, Series, residuals, robust_sd, runs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LONG_RUN, _AROUND = 5, 10  # samples and times the usual run of equal values; runs that tell the usual one
_CUT_RUN = 3  # samples that are equal only if cut off, where numbers lie on no grid
_FAR = 3.0  # times the usual change between runs
_MANY_SAME, _FEWEST_MOVING, _REACH = 0.15, 50, 5  # share, samples, and samples on either side
_RECURS = 1.1  # times that a number comes again, on average, where numbers lie on some grid
_STANDS_OUT, _STEPS = 8.0, 4.0  # times the noise, and steps of the numbers
_AGREE, _LATE = 0.5, 0.1  # of an outlier's height; intervals by which times may err
_LEAST_CUT, _FEW_NUMBERS, _LEAST_END = 0.002, 10, 0.5  # share of samples, numbers, of the largest size
_FAST = 3.0  # steps of the numbers with which a channel that is cut off reaches its end
_BESIDE = (-2, -1, 2, 3)  # samples before a jump, and after
_TURN, _TURN_ERR = 2 * np.pi, 0.5
_OTHER_NOISE = 3.0  # times
_SMOOTH, _COARSE = (
    -0.5,
    1e-3,
)  # correlation of neighbouring residuals (white: -0.8), share of the channel's sd
_MANY_JITTER, _LEAST_JITTER = 3.0, 0.02  # times the noise of slow samples, and of the interval


def odd_samples(measured: Measured) -> Iterator[Finding]:
    """What is odd in a channel's samples."""
    if np.ptp(measured.values) == 0:
        yield _constant(measured)
        return
    yield from _saturated(measured)
    if measured.channel.role == "control":
        return  # what was commanded may stand still, jump and wrap
    stuck = [_stuck(one, measured.grid) for one in measured.series]
    if any(mask.any() for mask in stuck):
        yield _of_samples(
            measured,
            "stuck_samples",
            stuck,
            f"{measured.name} stands still {sum(_stretches(mask) for mask in stuck)} times, "
            f"{sum(int(mask.sum()) for mask in stuck)} samples in all, and then jumps to where it would be",
            "sensor or bus stopped meanwhile: leave these samples out, or they look like friction",
        )
    yield from _repeated(measured, stuck)
    yield from _outliers(measured)
    if measured.channel.quantity == "position":
        yield from _jumps(measured, stuck)
        yield from _odd_motion(measured)
    yield from _other_noise(measured)


def _of_samples(measured: Measured, kind: FindingKind, masks: Sequence[Mask], what: str, why: str) -> Finding:
    """A finding of the episodes in which a mask holds anywhere."""
    where = tuple(one.episode for one, mask in zip(measured.series, masks, strict=True) if mask.any())
    return Finding(kind, what, where if len(measured.series) > 1 else (), why, "episode")


def _constant(measured: Measured) -> Finding:
    value = f"{measured.values[0]:g} {measured.channel.unit}"
    if measured.channel.role == "control":
        return Finding(
            "constant_control",
            f"control {measured.name} never changes from {value}",
            (),
            "neither its gain nor its delay can be told from a constant",
            "episode",
        )
    return Finding(
        "constant_channel",
        f"{measured.name} reads {value} in all {len(measured.values)} samples",
        (),
        "a sensor that is not connected, or what it measures is locked: it tells nothing",
        "episode",
    )


def _saturated(measured: Measured) -> Iterator[Finding]:
    """Stretches at the largest or smallest number that a channel reaches with speed."""
    values = measured.values
    if len(np.unique(values)) <= _FEW_NUMBERS:
        return  # steps between a few set points
    for end, word in ((float(values.max()), "largest"), (float(values.min()), "smallest")):
        if abs(end) < _LEAST_END * float(np.abs(values).max()):
            continue
        masks = [_cut_off(one.x, end, measured.grid) for one in measured.series]
        share = sum(int(mask.sum()) for mask in masks) / len(values)
        if share >= _LEAST_CUT:
            yield _of_samples(
                measured,
                "saturated",
                masks,
                f"{share:.1%} of the samples of {measured.name} sit at its {word} value, {end:.4g} "
                f"{measured.channel.unit}",
                "it is cut off there: what went beyond is not seen, or a limit acted that must be modelled",
            )


def _cut_off(x: Array, end: float, grid: float) -> Mask:
    """(n,) samples of long runs at `end` that were reached, or left, with a jump of several steps.

    A smooth signal comes to its largest value slowly, by one step of its numbers at last.
    """
    mask = np.zeros(len(x), dtype=bool)
    for first, last in zip(*runs(x), strict=True):
        if abs(x[first] - end) > grid / 2 or last - first + 1 < (_LONG_RUN if grid else _CUT_RUN):
            continue
        beside = [abs(x[i] - end) for i in (first - 1, last + 1) if 0 <= i < len(x)]
        if max(beside, default=0.0) >= _FAST * grid:
            mask[first : last + 1] = True
    return mask


def _stuck(one: Series, grid: float) -> Mask:
    """(n,) samples of runs that last much longer than those around them and end with a far jump."""
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


def _repeated(measured: Measured, stuck: Sequence[Mask]) -> Iterator[Finding]:
    """Samples that repeat the one before them while the channel changes by more than its step.

    Of two readings with normal noise of sd s, rounded to steps q << s, a share q / (2 s sqrt(pi)) is equal.
    """
    values = measured.values
    changes = sum(len(runs(one.x)[0]) for one in measured.series)
    if not measured.grid and changes > _RECURS * len(np.unique(values)):
        return  # numbers of a grid that nobody knows: equal ones may be neighbours on it
    same, moving = 0, 0
    for one, mask in zip(measured.series, stuck, strict=True):
        if len(one.x) > 2 * _REACH:
            slope = np.abs(one.x[2 * _REACH :] - one.x[: -2 * _REACH]) / (2 * _REACH)
            moves = (slope > 2 * measured.grid) & ~mask[_REACH:-_REACH]
            moving += int(moves.sum())
            same += int((moves & (np.diff(one.x) == 0)[_REACH - 1 : -_REACH]).sum())
    chance = measured.grid / (2 * np.sqrt(np.pi) * measured.noise) if measured.noise > 0 else 0.0
    if moving >= _FEWEST_MOVING and same / moving > _MANY_SAME + chance:
        rate = (1 - same / moving) / measured.sampling.interval_s
        yield Finding(
            "repeated_samples",
            f"{same / moving:.0%} of the samples of {measured.name} repeat the one before them while it "
            f"changes, as if it were read {rate:.3g} times a second",
            (),
            "rows are written more often than the sensor is read, so what they say is old: give it a clock",
            "episode",
        )


def _outliers(measured: Measured) -> Iterator[Finding]:
    """Single samples far from neighbours that agree with each other."""
    masks = []
    for one in measured.series:
        mask = np.zeros(len(one.x), dtype=bool)
        if len(one.x) > 4:
            height, spread, late = _above_line(one)
            least = np.maximum(max(_STANDS_OUT * measured.noise, _STEPS * measured.grid), late)
            mask[2:-2] = (height > least) & (spread < _AGREE * height)
        masks.append(mask)
    count = sum(int(mask.sum()) for mask in masks)
    if count:
        yield _of_samples(
            measured,
            "outliers",
            masks,
            f"{count} of {len(measured.values)} samples of {measured.name} stand out from their neighbours",
            f"readings, or their times, off by {_STANDS_OUT:g} times the noise outweigh all others: leave them out",
        )


def _above_line(one: Series) -> tuple[Array, Array, Array]:
    """How far each sample lies from the line through its four neighbours, which is told with each.

    Returns:
        (n - 4,) distance from the line, spread of the neighbours about it, and what the line does in a tenth
        of an interval: as far off is a time that errs, and no wrong reading.
    """
    t, x = (np.stack([part[:-4], part[1:-3], part[3:-1], part[4:]]) for part in (one.t, one.x))  # (4, n - 4)
    middle, since = x.mean(axis=0), t - t.mean(axis=0)
    slope = (since * x).sum(axis=0) / (since**2).sum(axis=0)
    height = one.x[2:-2] - middle - slope * (one.t[2:-2] - t.mean(axis=0))
    return np.abs(height), np.ptp(x - slope * since, axis=0), np.abs(slope) * np.ptp(t, axis=0) / 4 * _LATE


def _jumps(measured: Measured, stuck: Sequence[Mask]) -> Iterator[Finding]:
    """Changes of a position from one sample to the next that its speed before and after does not explain."""
    turns, others = [], []
    for one, mask in zip(measured.series, stuck, strict=True):
        excess = _excess(one, max(_STANDS_OUT * measured.noise, _STEPS * measured.grid))
        turned = (np.abs(np.abs(excess) - _TURN) < _TURN_ERR) & (measured.channel.unit == "rad")
        turns.append(turned)
        others.append((excess != 0) & ~turned & ~np.append(False, mask[:-1]))
    for kind, masks, what, why in (
        (
            "wraps",
            turns,
            "jumps by a whole turn, {} times",
            "an angle that wraps does not move so: unwrap it (numpy.unwrap), for simulated joints turn on",
        ),
        (
            "jumps",
            others,
            "jumps {} times by more than its speed before and after explains",
            "an encoder slipped, samples are lost, or two recordings were joined: split the episode there",
        ),
    ):
        count = sum(int(mask.sum()) for mask in masks)
        if count:
            yield _of_samples(measured, kind, masks, f"{measured.name} {what.format(count)}", why)  # type: ignore[arg-type]


def _excess(one: Series, least: float) -> Array:
    """How far a sample and those after it lie from where those before it lead.

    Args:
        one: samples.
        least: of a distance that counts.

    Returns:
        (n,) distance, 0 where there is none.
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
    stays = (after > _AGREE * np.abs(excess)).all(axis=0) & (before < _AGREE * np.abs(excess)).all(axis=0)
    fastest = np.abs(around[[0, -1]]).max(axis=0) * interval[2:-2]
    far = np.abs(excess) > np.maximum(least, _FAR * fastest)
    found[here + 1] = np.where(far & stays, excess, 0.0)
    return found


def _odd_motion(measured: Measured) -> Iterator[Finding]:
    """Positions that scatter more at speed, since their times err, or change too much between samples."""
    parts = [(residuals(one.t, one.x), *_speed(one)) for one in measured.series if len(one.t) > 4]
    if not parts:
        return
    left, speed, interval = (np.concatenate(part) for part in zip(*parts, strict=True))
    most = 3 * robust_sd(left)  # a stop or a wrong reading tells nothing of the others
    neighbours = np.stack(
        [
            np.concatenate([np.clip(part[0][rows], -most, most) for part in parts])
            for rows in (slice(None, -1), slice(1, None))
        ]
    )
    # Of less, rounding is all there is, or a simulation without noise.
    large = robust_sd(left) > max(measured.grid, _COARSE * float(measured.values.std()))
    if large and np.corrcoef(neighbours)[0, 1] > _SMOOTH:
        yield Finding(
            "coarse_sampling",
            f"{measured.name} bends between samples: what a cubic through its neighbours misses "
            f"({robust_sd(left):.2g} {measured.channel.unit}) is no noise",
            (),
            "noise cannot be told, and motion between samples is not seen: record more often",
            "episode",
        )
        return
    slow, fast = speed <= np.quantile(speed, 0.5), speed >= np.quantile(speed, 0.9)
    still = max(robust_sd(left[slow]), measured.grid / np.sqrt(12))
    moving, typical = robust_sd(left[fast]), float(np.median(speed[fast]))
    if moving > _MANY_JITTER * still and typical > 0:
        jitter = np.sqrt(moving**2 - still**2) / typical
        if jitter > _LEAST_JITTER * float(np.median(interval)):
            yield Finding(
                "moving_noise",
                f"{measured.name} scatters by {moving:.2g} {measured.channel.unit} where it is fast and by "
                f"{still:.2g} where it is slow, as if its times erred by {1000 * jitter:.2g} ms",
                (),
                "noise that grows with speed is none of place: weighed alike, all samples show it as physics",
                "episode",
            )


def _speed(one: Series) -> tuple[Array, Array]:
    """(n - 4,) speed about each sample that has two neighbours on either side, and interval there."""
    span = one.t[4:] - one.t[:-4]
    return np.abs(one.x[4:] - one.x[:-4]) / span, span / 4


def _other_noise(measured: Measured) -> Iterator[Finding]:
    """Noise that is not what the recording says."""
    given = measured.channel.noise
    if given is None or np.isnan(measured.noise) or measured.noise == 0:
        return
    if not 1 / _OTHER_NOISE < given / measured.noise < _OTHER_NOISE:
        yield Finding(
            "noise_differs",
            f"the noise of {measured.name} is said to be {given:.2g} {measured.channel.unit}, but samples "
            f"scatter by {measured.noise:.2g}",
            (),
            "what is left over is weighed with it: too small a noise makes everything significant",
            "episode",
        )
