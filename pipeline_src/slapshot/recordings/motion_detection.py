"""Detect when a tracked object moves and when it rests, from its track alone.

Trackers flicker, lose the object for a frame and report positions where it never was, and people nudge an
object before a hit or carry it back after one. Speed is therefore computed over a window of several frames,
the threshold for motion follows from the frames at rest, and jumps are distinguished from slides.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from slapshot.arrays import Array

HALF_WINDOW_S = 0.03
_OUTLIER_FRAMES = 5  # a median over this many frames rejects one or two outliers
_PAUSE_S = 0.1  # a shorter halt does not separate two motions
# The speed threshold for motion lies between these two, in m/s: creeping and the flicker of a good tracker
# stay below the first, and nothing at rest exceeds the second.
_SLOWEST, _FASTEST_REST = 0.03, 0.2
# Factor on the lower quartile of the speed at rest: five standard deviations of normal noise, and not much
# more where half of the slow frames are the end of a slide.
_NOISE = 6.6
_MIN_TRAVEL_M = 0.02
_MIN_SHARE = 0.2  # of the longest motion: a nudge is shorter
# Only a jump starts and stops within one frame interval: friction never decelerates an object that fast.
_JUMP_SHARE, _JUMP_DECELERATION = 0.8, 50.0


@dataclass(frozen=True)
class MotionInterval:
    """An interval in which the object moves.

    Attributes:
        begin: frame at which it begins, at most half a window too early.
        end: first frame at rest after it, at most half a window too late; the number of frames if none is.
        travel: m, from its first to its last place.
        jump: whether it is a change of position between two frames rather than a motion.
    """

    begin: int
    end: int
    travel: float
    jump: bool


def half_window(t: Array) -> int:
    """Number of frames on either side over which speed is computed.

    Args:
        t: (n,) s.
    """
    interval = float(np.median(np.diff(t))) if len(t) > 1 else HALF_WINDOW_S
    return max(1, round(HALF_WINDOW_S / interval))


def smooth(xy: Array) -> Array:
    """(n, 2) positions in m without single outliers: a running median preserves monotonic motion."""
    return median_filter(xy, size=(_OUTLIER_FRAMES, 1), mode="mirror")


def windowed_speed(t: Array, xy: Array) -> Array:
    """Speed over a window around each frame.

    Args:
        t: (n,) s, increasing.
        xy: (n, 2) m.

    Returns:
        (n,) m/s; zeros for a single frame.
    """
    if len(t) < 2:
        return np.zeros(len(t))
    place, frames, k = smooth(xy), np.arange(len(t)), half_window(t)
    before, after = np.maximum(frames - k, 0), np.minimum(frames + k, len(t) - 1)
    return np.linalg.norm(place[after] - place[before], axis=1) / (t[after] - t[before])


def moving_speed(speed: Array) -> float:
    """Speed threshold in m/s above which an object moves, from (n,) speeds that are mostly noise."""
    quiet = speed[speed < _FASTEST_REST]
    if len(quiet) < _OUTLIER_FRAMES:
        return (_SLOWEST + _FASTEST_REST) / 2
    return float(np.clip(_NOISE * np.percentile(quiet, 25), _SLOWEST, _FASTEST_REST))


def find_motion_intervals(t: Array, xy: Array) -> list[MotionInterval]:
    """All intervals in which the object moves, in order; less than 2 cm of travel does not count.

    Args:
        t: (n,) s, increasing.
        xy: (n, 2) m.
    """
    speed, place = windowed_speed(t, xy), smooth(xy)
    edges = np.flatnonzero(np.diff(np.r_[False, speed > moving_speed(speed), False]))
    runs: list[list[int]] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if runs and t[begin] - t[runs[-1][1] - 1] < _PAUSE_S:
            runs[-1][1] = end
        else:
            runs.append([begin, end])
    found = []
    for begin, end in runs:
        inside = place[begin : min(end + 1, len(t))]
        travel = float(np.linalg.norm(inside - inside[0], axis=1).max())
        if travel >= _MIN_TRAVEL_M:
            found.append(
                MotionInterval(begin, end, travel, _is_jump(t[begin : begin + len(inside)], inside, travel))
            )
    return found


def find_slide(intervals: list[MotionInterval]) -> MotionInterval | None:
    """The first motion that is neither a jump nor a nudge, which is the slide of a hit; None without one."""
    real = [interval for interval in intervals if not interval.jump]
    farthest = max((interval.travel for interval in real), default=0.0)
    return next((interval for interval in real if interval.travel >= _MIN_SHARE * farthest), None)


def _is_jump(t: Array, place: Array, travel: float) -> bool:
    if len(t) < 2:
        return False
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    longest = int(steps.argmax())
    deceleration = steps[longest] / (t[longest + 1] - t[longest]) ** 2
    return bool(steps[longest] > _JUMP_SHARE * travel and deceleration > _JUMP_DECELERATION)
