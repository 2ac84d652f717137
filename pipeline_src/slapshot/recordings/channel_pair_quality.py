"""Quality warnings about two channels of the same quantity, on one clock or two: `channel_pair_warnings`.

Position a and position or velocity b of one joint (or site, or body) must agree up to noise. With b
integrated where it is a velocity, a is fitted in short windows by

    a(t) = gain * b(t + delay) + offset [+ drift * t of an integral]

linearised in the delay: b(t + delay) = b(t) + delay * db/dt.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from slapshot.arrays import Array
from slapshot.recordings.channels import QUATERNION, Channel
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.signal_statistics import MAD_TO_SD, ChannelStatistics, Series

_WINDOW, _MIN_WINDOWS, _MAX_WINDOWS = 100, 4, 20  # samples; windows; windows of an episode
_ITERATIONS = 4
_FOLLOWS = 0.9  # share of a window's variance that the fit must explain
_DELAYED, _SIGNIFICANT = 1.5, 4.0  # intervals, and standard errors
_OTHER_SCALE = 0.1
_LAGS = 20, 100  # fewest and most samples on either side: filters of 5 Hz last for about 0.1 s
_PER_LAG = 5, 20  # fewest samples of an episode and of all
_MIN_SAMPLES, _MAX_SAMPLES = 500, 40_000  # of a pair
_MIN_INDEPENDENT = 0.5  # share of a velocity's noise that is independent of the position
_ROUNDING = 1.5  # times what rounding leaves


def channel_pair_warnings(channels: Sequence[ChannelStatistics]) -> Iterator[QualityWarning]:
    """Quality warnings about pairs of channels that measure the same quantity."""
    for first, second in combinations(channels, 2):
        if _same_quantity(first.channel, second.channel):
            a, b = (first, second) if first.channel.quantity == "position" else (second, first)
            if a.channel.quantity == "position" and min(np.ptp(a.samples), np.ptp(b.samples)) > 0:
                yield from _pair_warnings(a, b)


def differentiated_velocities(channels: Sequence[ChannelStatistics]) -> list[str]:
    """Names of velocity channels that were differentiated from a recorded position and add no information."""
    names = set()
    for a, b in permutations(channels, 2):
        pair = (a.channel.quantity, b.channel.quantity) == ("position", "velocity")
        if pair and a.channel.clock == b.channel.clock and _same_quantity(a.channel, b.channel):
            names |= {b.name for _ in _differentiated_velocity(a, b)}
    return sorted(names)


def _same_quantity(a: Channel, b: Channel) -> bool:
    if a.target is None or a.target != b.target or a.component != b.component or a.component in QUATERNION:
        return False
    if {a.role, b.role} != {"observation"} or not {a.quantity, b.quantity} <= {"position", "velocity"}:
        return False
    return a.unit.removesuffix("/s") == b.unit.removesuffix("/s")


def _pair_warnings(a: ChannelStatistics, b: ChannelStatistics) -> Iterator[QualityWarning]:
    windows = list(_windows(a, b))
    if a.channel.clock == b.channel.clock and b.channel.quantity == "velocity":
        yield from _differentiated_velocity(a, b)
    if len(windows) < _MIN_WINDOWS:
        return
    gain, delay = (np.array([getattr(window, of) for window in windows]) for of in ("gain", "delay"))
    scale = 1 / float(np.median(gain))
    if abs(scale - 1) > _OTHER_SCALE:
        of = "the change of " if b.channel.quantity == "velocity" else ""
        yield QualityWarning(
            "scale_differs",
            f"{b.name} is {scale:.3g} times {of}{a.name}",
            (),
            "one of them has another unit, sign, gear ratio or joint: correct it, or name its joint",
            "episode",
        )
        return
    yield from _delay_warnings(a, b, windows, delay)


class _Window(NamedTuple):
    """Fit of a by b in one window of an episode.

    Attributes:
        episode: number of it.
        t: middle of the stretch in s.
        gain: of b in a.
        delay: s by which b lags a.
    """

    episode: int
    t: float
    gain: float
    delay: float


def _windows(a: ChannelStatistics, b: ChannelStatistics) -> Iterator[_Window]:
    """Fits of a by b in the windows in which b explains a."""
    of_b = {one.episode: one for one in b.series}
    for one in a.series:
        other = of_b.get(one.episode)
        if other is None or len(other.t) < _WINDOW or len(one.t) < _WINDOW:
            continue
        place, speed = _position_and_speed(other, b.channel.quantity == "velocity")
        count = min(len(one.t) // _WINDOW, _MAX_WINDOWS)
        for rows in np.array_split(np.arange(len(one.t)), count):
            fitted = _fit(one.t[rows], one.x[rows], other.t, place, speed, b.channel.quantity == "velocity")
            if fitted is not None:
                yield _Window(one.episode, float(one.t[rows].mean()), *fitted)


def _position_and_speed(one: Series, is_velocity: bool) -> tuple[Array, Array]:
    if is_velocity:
        return cumulative_trapezoid(one.x, one.t, initial=0), one.x
    return one.x, np.gradient(one.x, one.t)


def _fit(
    t: Array, x: Array, t_b: Array, place: Array, speed: Array, integral: bool
) -> tuple[float, float] | None:
    """Gain and delay; None where b does not explain a."""
    delay, gain = 0.0, 1.0
    for _ in range(_ITERATIONS):
        inside = (t + delay >= t_b[0]) & (t + delay <= t_b[-1])
        if inside.sum() < _WINDOW / 2:
            return None
        moments, seen = t[inside] + delay, x[inside]
        columns = [np.interp(moments, t_b, place), np.interp(moments, t_b, speed), np.ones_like(moments)]
        if integral:
            columns.append(t[inside] - t[inside].mean())
        design = np.stack(columns, axis=1)
        coefficients, *_ = np.linalg.lstsq(design, seen, rcond=None)
        gain = float(coefficients[0])
        if gain == 0:
            return None
        delay += float(coefficients[1]) / gain
    # After removal of offset and drift, which would explain any slow motion.
    rest, *_ = np.linalg.lstsq(design[:, 2:], seen, rcond=None)
    moved = seen - design[:, 2:] @ rest
    left = seen - design @ coefficients
    if float(left @ left) > (1 - _FOLLOWS) * float(moved @ moved):
        return None
    return gain, delay


def _delay_warnings(
    a: ChannelStatistics, b: ChannelStatistics, windows: list[_Window], delay: Array
) -> Iterator[QualityWarning]:
    """Delays between the channels, and drift between their clocks."""
    interval = max(a.sampling.interval_s, b.sampling.interval_s)
    typical = float(np.median(delay))
    error = MAD_TO_SD * float(np.median(np.abs(delay - typical))) * 1.25 / np.sqrt(len(delay))
    if abs(typical) > max(_DELAYED * interval, _SIGNIFICANT * error):
        late, early = (b, a) if typical > 0 else (a, b)
        yield QualityWarning(
            "late_channel",
            f"{late.name} is {1000 * abs(typical):.3g} ms (+- {1000 * error:.1g}) later than {early.name}",
            (),
            "its clock, filter or bus adds a delay: model it, or it is mistaken for damping",
            "episode",
        )
    if a.channel.clock == b.channel.clock:
        return
    episodes = np.array([window.episode for window in windows])
    t = np.array([window.t for window in windows])
    first = [episodes == episode for episode in np.unique(episodes)]
    delay = delay.copy()
    for rows in first:  # clocks may have an offset that differs between episodes
        t[rows] -= t[rows].mean()
        delay[rows] -= delay[rows].mean()
    freedom = len(t) - len(first) - 1
    if freedom < 1 or float(t @ t) == 0:
        return
    rate = float(t @ delay) / float(t @ t)
    rest = delay - rate * t
    rate_error = float(np.sqrt(rest @ rest / freedom / (t @ t)))
    longest = max(float(one.t[-1] - one.t[0]) for one in a.series)
    if abs(rate) * longest > interval and abs(rate) > _SIGNIFICANT * rate_error:
        yield QualityWarning(
            "clock_drift",
            f"clock {b.channel.clock} drifts by {1000 * rate:+.3g} ms per second against clock "
            f"{a.channel.clock}, "
            f"according to {a.name} and {b.name}",
            (),
            "simultaneous samples have different time stamps: use one clock for both, or rescale one",
            "episode",
        )


def _differentiated_velocity(a: ChannelStatistics, b: ChannelStatistics) -> Iterator[QualityWarning]:
    """A velocity that was computed from the recorded position.

    Such a velocity is a filtered difference quotient of the position, including its noise. The noise is
    therefore compared: both are differenced four times, which removes most of the motion, and the velocity is
    predicted from the quotient within 20 samples on either side, or up to 100 where there are enough, fitted
    in one half and validated in the other.
    """
    quotient, velocity = _quotients(a, b)
    lengths = [len(x) for x in velocity]
    if sum(lengths) < _MIN_SAMPLES:
        return
    most = min(_LAGS[1], int(np.median(lengths)) // _PER_LAG[0], sum(lengths) // _PER_LAG[1])
    lags = max(_LAGS[0], most)
    before, after = ([_fourth_difference(x) for x in each] for each in (quotient, velocity))
    own = 1 - _explained(before, after, lags)[0]
    # Over many samples a filtered position is as precise as a coarse sensor.
    left = _explained(quotient, velocity, _LAGS[0])[1]
    rounding = b.grid / np.sqrt(12)
    if own < _MIN_INDEPENDENT or left < _ROUNDING * rounding:
        how = (
            f"{1 - own:.0%} of its noise is that of {a.name}"
            if own < _MIN_INDEPENDENT
            else f"except for rounding it is a filtered {a.name}"
        )
        yield QualityWarning(
            "no_own_velocity",
            f"{b.name} looks like the difference quotient of {a.name}: {how}",
            (),
            "it adds no information to the position: treated as a second sensor, errors count twice",
            "episode",
        )


def _quotients(a: ChannelStatistics, b: ChannelStatistics) -> tuple[list[Array], list[Array]]:
    """Difference quotients of a and values of b at the same samples, by episode."""
    of_b = {one.episode: one for one in b.series}
    quotients, velocities = [], []
    for one in a.series:
        other = of_b.get(one.episode)
        if other is None:
            continue
        t, rows_a, rows_b = np.intersect1d(one.t, other.t, return_indices=True)
        if len(t) > 2 * _LAGS[0] + 10:
            quotients.append(np.diff(one.x[rows_a]) / np.diff(t))
            velocities.append(other.x[rows_b][1:])
    return quotients, velocities


def _fourth_difference(x: Array) -> Array:
    return np.diff(x, 4)


def _explained(inputs: list[Array], outputs: list[Array], lags: int) -> tuple[float, float]:
    """Share of the output's variance that a filter of the input explains, and robust sd of the residual.

    Both are computed on samples that the filter was not fitted to. It reaches over `lags` samples either way.
    """
    every = 1 + sum(map(len, outputs)) // _MAX_SAMPLES
    lagged, wanted = [], []
    for x, y in zip(inputs, outputs, strict=True):
        if len(x) > 2 * lags:
            lagged.append(np.lib.stride_tricks.sliding_window_view(x, 2 * lags + 1)[::every])
            wanted.append(y[lags : len(y) - lags : every])
    design, target = np.concatenate(lagged), np.concatenate(wanted)
    half = len(target) // 2
    coefficients, *_ = np.linalg.lstsq(design[:half], target[:half], rcond=None)
    rest = target[half:] - design[half:] @ coefficients
    variance = float(target[half:] @ target[half:])
    share = 1 - float(rest @ rest) / variance if variance > 0 else 0.0
    return share, MAD_TO_SD * float(np.median(np.abs(rest)))
