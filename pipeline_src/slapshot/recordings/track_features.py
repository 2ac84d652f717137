"""Launch, friction and noise of each hit, estimated from its track alone, before any model is fitted.

The slide is evaluated from its last speed peak, which excludes a second push of the arm, until the speed has
fallen to a tenth. Along its chord s, with the speed v and the deceleration a at its beginning,

    s(t) = v t - a t^2 / 2,    friction = a / g,    stopping friction = v^2 / (2 g d)

with d the distance to the rest point. For Coulomb friction both agree.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import find_peaks

from slapshot.arrays import GRAVITY, Array
from slapshot.recordings.format import Recording
from slapshot.recordings.motion_detection import (
    MotionInterval,
    find_motion_intervals,
    find_slide,
    half_window,
    windowed_speed,
)

_FAR_NOISE, _FAR_M = 8.0, 0.005  # beyond both, a frame at rest is an outlier
_SLOW_SHARE = 0.1  # of the launch speed: below it, creep dominates
_MIN_FRAMES = 6
_FAR_RESIDUAL = 4.0  # times the typical residual: such a frame is a mistrack
_PUSH_S = 0.07  # a push accelerates the object for longer than half of this
_SECOND_PUSH = 0.15  # share of the highest speed by which it rises again


@dataclass(frozen=True)
class HitTrack:
    """The track of a hit.

    Attributes:
        hit: its number.
        t: (n,) s.
        xy: (n, 2) m.
        speed: (n,) m/s, over a window.
        motion_intervals: all intervals in which it moves.
        slide: the interval that is the hit, or None.
        pushes: frames of the peaks of speed within it, at least one with a slide.
    """

    hit: int
    t: Array
    xy: Array
    speed: Array
    motion_intervals: tuple[MotionInterval, ...]
    slide: MotionInterval | None
    pushes: tuple[int, ...]

    @property
    def before(self) -> Array:
        """(k, 2) m, the frames at rest before it first moves."""
        return self.xy[: self.motion_intervals[0].begin] if self.motion_intervals else self.xy

    @property
    def after(self) -> Array:
        """(k, 2) m, the frames at rest after the slide."""
        if self.slide is None:
            return self.xy[:0]
        later = [e.begin for e in self.motion_intervals if e.begin >= self.slide.end]
        return self.xy[self.slide.end : min(later, default=len(self.t))]


def hit_tracks(recording: Recording) -> list[HitTrack]:
    """Tracks of all hits that have one, in the order of execution."""
    if recording.tracks is None:
        return []
    rows = dict(list(recording.tracks.groupby("hit")))
    order = recording.hits.sort_values("order")["hit"]
    return [hit_track(int(hit), rows[hit]) for hit in order if hit in rows]


def hit_track(hit: int, frames: pd.DataFrame) -> HitTrack:
    """Track of one hit with its motion detected; `frames` has columns t, x, y."""
    t, xy = frames["t"].to_numpy(np.float64), frames[["x", "y"]].to_numpy(np.float64)
    motions = tuple(find_motion_intervals(t, xy))
    slide, speed = find_slide(list(motions)), windowed_speed(t, xy)
    pushes: tuple[int, ...] = ()
    if slide is not None:
        pushes = _find_pushes(t, speed, slide)
    return HitTrack(hit, t, xy, speed, motions, slide, pushes)


def _find_pushes(t: Array, speed: Array, slide: MotionInterval) -> tuple[int, ...]:
    """Frames at which the speed peaks; a running median rejects up to two consecutive outliers."""
    moving = speed[slide.begin : slide.end]
    half = min(
        _PUSH_S / 2 / float(np.median(np.diff(t))), len(moving)
    )  # clock errors may be arbitrarily large
    inside = median_filter(moving, size=max(5, 2 * round(half) + 1), mode="nearest")
    # Padded, because a track that begins at the launch has its peak in the first frame.
    peaks, _ = find_peaks(np.r_[0.0, inside, 0.0], prominence=_SECOND_PUSH * inside.max())
    return tuple(int(slide.begin + peak - 1) for peak in peaks)


def slide_table(tracks: list[HitTrack]) -> pd.DataFrame:
    """Launch and friction of each hit whose slide can be fitted.

    Args:
        tracks: of the hits.

    Returns:
        One row a hit: hit, launch_speed (m/s), heading (rad), x, y (m, middle of the slide), distance (m, to
        rest), friction and its standard error (1), stopping_friction (1; NaN without rest), late_friction
        (1; of the slower half), residual (m, standard deviation of the frames about the fit), jitter (s, the
        error of frame times that would explain scatter beyond the noise at rest) and rest_noise (m).
    """
    rows = [row for track in tracks if (row := _fit_slide(track)) is not None]
    names = ["hit", "launch_speed", "heading", "x", "y", "distance", "friction", "friction_se"]
    names += ["stopping_friction", "late_friction", "residual", "jitter", "rest_noise"]
    return pd.DataFrame(rows, columns=names)


def rest_noise(track: HitTrack) -> float:
    """Standard deviation in m, for each axis, of the position at rest, with drift and flicker, without jumps.

    The larger of the values before and after the hit; NaN if too few frames show the object at rest.
    """
    spreads = [_spread(rest) for rest in (track.before, track.after) if len(rest) >= _MIN_FRAMES]
    return max(spreads, default=float("nan"))


def _spread(rest: Array) -> float:
    off = np.linalg.norm(rest - np.median(rest, axis=0), axis=1)
    near = off <= max(_FAR_NOISE * float(np.median(off)), _FAR_M)
    return float(np.sqrt(np.mean(off[near] ** 2) / 2))


def _fit_slide(track: HitTrack) -> dict[str, float] | None:
    found = _sliding_frames(track)
    if found is None:
        return None
    t, xy = track.t[found] - track.t[found[0]], track.xy[found]
    chord = xy[-1] - xy[0]
    ahead = chord / np.linalg.norm(chord)
    s = (xy - xy[0]) @ ahead
    good = _cubic_inliers(t, s)
    t, s = t[good], s[good]
    late = t > t[-1] / 2
    if len(t) < _MIN_FRAMES or late.sum() < 3:
        return None
    (half_a, speed, _), covariance = np.polyfit(t, s, 2, cov=True)
    if speed <= 0:
        return None
    off = s - np.polyval(np.polyfit(t, s, 3), t)
    residual, noise = float(np.std(off)), rest_noise(track)
    v = np.maximum(speed + 2 * half_a * t, 0.0)
    excess = np.maximum(off**2 - (0.0 if np.isnan(noise) else noise**2), 0.0)
    rest = np.median(track.after, axis=0) if len(track.after) else np.full(2, np.nan)
    distance = float((rest - xy[0]) @ ahead)
    return {
        "hit": track.hit,
        "launch_speed": float(speed),
        "heading": float(np.arctan2(ahead[1], ahead[0])),
        "x": float(xy[:, 0].mean()),
        "y": float(xy[:, 1].mean()),
        "distance": distance,
        "friction": -2 * half_a / GRAVITY,
        "friction_se": 2 * float(np.sqrt(covariance[0, 0])) / GRAVITY,
        "stopping_friction": speed**2 / (2 * GRAVITY * distance) if distance > 0 else np.nan,
        "late_friction": -2 * float(np.polyfit(t[late], s[late], 2)[0]) / GRAVITY,
        "residual": residual,
        "jitter": float(np.sqrt(excess.sum() / np.sum(v**2))),
        "rest_noise": noise,
    }


def _cubic_inliers(t: Array, s: Array) -> NDArray[np.bool_]:
    """(n,) mask of frames near a cubic fit to (n,) positions s in m at (n,) times t in s."""
    good = np.ones(len(t), dtype=bool)
    for _ in range(3):
        if good.sum() < _MIN_FRAMES:
            break
        off = np.abs(s - np.polyval(np.polyfit(t[good], s[good], 3), t))
        good = off <= _FAR_RESIDUAL * 1.4826 * np.median(off[good]) + 1e-12
    return good


def _sliding_frames(track: HitTrack) -> NDArray[np.int64] | None:
    """Frames after the last push and before creep; None if there are too few."""
    if track.slide is None or not track.pushes:
        return None
    last = track.pushes[-1]
    begin = last + half_window(track.t) if last > track.slide.begin else last
    frames = np.arange(begin, min(track.slide.end, len(track.t)))
    slow = track.speed[frames] < _SLOW_SHARE * track.speed[last]
    frames = frames[: int(slow.argmax())] if slow.any() else frames
    return frames if len(frames) >= _MIN_FRAMES else None
