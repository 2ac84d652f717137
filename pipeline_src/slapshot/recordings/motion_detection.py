"""When a tracked object moves and when it rests, told from its track alone.

Trackers flicker, lose the object for a frame and report places where it never was, and people nudge an
object before a hit or carry it back after one. So speed is taken over a window of some frames, what
counts as moving follows from the frames that rest, and a jump is told from a slide.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from slapshot.arrays import Array

HALF_WINDOW_S = 0.03
_OUTLIER_FRAMES = 5  # a median over so many frames passes no one or two wrong ones
_PAUSE_S = 0.1  # a shorter halt does not part one motion from the next
# Between these two the speed lies that counts as moving, in m/s: below the first creeping and flicker of
# a good tracker are, above the second nothing is that a camera takes for rest.
_SLOWEST, _FASTEST_REST = 0.03, 0.2
# Times the lower quartile of the speed at rest: five standard deviations of normal noise, and still not much
# more than that where half of the slow frames are the end of a slide.
_NOISE = 6.6
_LEAST_TRAVEL_M = 0.02
_LEAST_SHARE = 0.2  # of the farthest motion: a nudge is shorter
# In one interval hardly anything but a jump both starts and stops: friction never decelerates so.
_JUMP_SHARE, _JUMP_DECELERATION = 0.8, 50.0


@dataclass(frozen=True)
class Episode:
    """A time in which the object moves.

    Attributes:
        begin: frame at which it begins, at most half a window too early.
        end: first frame at rest after it, at most half a window too late; the number of frames if none is.
        travel: m, from its first to its last place.
        jump: whether it is no motion but a change of place between two frames.
    """

    begin: int
    end: int
    travel: float
    jump: bool


def half_window(t: Array) -> int:
    """Frames on either side over which speed is taken.

    Args:
        t: (n,) s.
    """
    interval = float(np.median(np.diff(t))) if len(t) > 1 else HALF_WINDOW_S
    return max(1, round(HALF_WINDOW_S / interval))


def smooth(xy: Array) -> Array:
    """(n, 2) places in m without single wrong frames: a running median keeps what moves one way."""
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
    """Speed in m/s above which an object moves, from the (n,) speeds of which most quiet ones are noise."""
    quiet = speed[speed < _FASTEST_REST]
    if len(quiet) < _OUTLIER_FRAMES:
        return (_SLOWEST + _FASTEST_REST) / 2
    return float(np.clip(_NOISE * np.percentile(quiet, 25), _SLOWEST, _FASTEST_REST))


def find_episodes(t: Array, xy: Array) -> list[Episode]:
    """All times in which the object moves, in order; short of 2 cm is no motion.

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
        if travel >= _LEAST_TRAVEL_M:
            found.append(
                Episode(begin, end, travel, _is_jump(t[begin : begin + len(inside)], inside, travel))
            )
    return found


def find_slide(episodes: list[Episode]) -> Episode | None:
    """The first motion that is neither a jump nor a mere nudge: what a hit does; None without one."""
    real = [episode for episode in episodes if not episode.jump]
    farthest = max((episode.travel for episode in real), default=0.0)
    return next((episode for episode in real if episode.travel >= _LEAST_SHARE * farthest), None)


def _is_jump(t: Array, place: Array, travel: float) -> bool:
    if len(t) < 2:
        return False
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    longest = int(steps.argmax())
    deceleration = steps[longest] / (t[longest + 1] - t[longest]) ** 2
    return bool(steps[longest] > _JUMP_SHARE * travel and deceleration > _JUMP_DECELERATION)
