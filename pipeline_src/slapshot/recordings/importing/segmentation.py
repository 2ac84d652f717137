"""Segmentation of a track: which frames are the hit, and the object's start and rest points."""

from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array
from slapshot.recordings.importing.mapping import Crop, TrackMapping
from slapshot.recordings.motion_detection import MotionInterval, find_motion_intervals, find_slide

_MIN_FRAMES = 5
_START_WINDOW_S = 0.2  # before motion begins: earlier frames may be from before a nudge
_REST_FRAMES = 3  # fewer are no rest


@dataclass(frozen=True)
class HitSegment:
    """The part of a track that belongs to the hit.

    Attributes:
        first, last: frames that stay, the last one included.
        start: (2,) m, median of the frames before motion.
        rest: (2,) m, median of the frames at rest after it; NaN where the object was not seen to rest.
        remarks: notes for the user.
        dropped: why the track contains no hit, or None.
    """

    first: int
    last: int
    start: Array
    rest: Array
    remarks: tuple[str, ...]
    dropped: str | None


def segment_hit(t: Array, xy: Array, mapping: TrackMapping) -> HitSegment:
    """Find the hit in a track.

    Args:
        t: (n,) s, increasing.
        xy: (n, 2) m.
        mapping: says what to keep.
    """
    if len(t) < _MIN_FRAMES:
        return _dropped(f"has only {len(t)} frames")
    intervals = find_motion_intervals(t, xy)
    slide = find_slide(intervals)
    if slide is None:
        farthest = 1000 * float(np.linalg.norm(xy - np.median(xy, axis=0), axis=1).max())
        jumps = " and only jumps" if intervals else ""
        return _dropped(f"never moves{jumps} (at most {farthest:.0f} mm from its median place)")
    remarks = []
    if slide.begin == 0:
        if mapping.moving_at_start == "drop":
            return _dropped("moves from its first frame on: its start was not recorded")
        remarks.append("moves from its first frame on")
    at_rest = slide.end <= len(t) - _REST_FRAMES
    if not at_rest:
        if mapping.moving_at_end == "drop":
            return _dropped("still moves in its last frame: its rest was not recorded")
        remarks.append("still moves in its last frame: its rest point stays empty")
    first, last = _window(t, slide, intervals, mapping.crop)
    rest_end = min([interval.begin for interval in intervals if interval.begin >= slide.end], default=len(t))
    remarks += _other_motions(t, slide, intervals)
    whole, kept = t[-1] - t[0], t[last] - t[first]
    if kept > mapping.longest_s:
        return _dropped(f"lasts {kept:.0f} s, longer than longest_s = {mapping.longest_s:g}; crop it")
    if whole > mapping.longest_s:
        remarks.append(f"lasted {whole:.0f} s and was cropped to {kept:.1f} s")
    rest = xy[slide.end : min(last + 1, rest_end)]
    return HitSegment(
        first=first,
        last=last,
        start=_start(t, xy, slide, first),
        rest=np.median(rest, axis=0) if at_rest and len(rest) >= _REST_FRAMES else np.full(2, np.nan),
        remarks=tuple(remarks),
        dropped=None,
    )


def _window(
    t: Array, slide: MotionInterval, intervals: list[MotionInterval], crop: Crop | None
) -> tuple[int, int]:
    """First and last frame to keep; motion after the slide has come to rest is not part of the hit."""
    if crop is None:
        return 0, len(t) - 1
    first = int(np.searchsorted(t, t[slide.begin] - crop.before_motion_s))
    end = min(slide.end, len(t) - 1)
    last = int(np.searchsorted(t, t[end] + crop.after_rest_s, side="right")) - 1
    later = [interval.begin - 1 for interval in intervals if interval.begin > slide.end]
    return first, max(end, min([last, *later]))


def _other_motions(t: Array, slide: MotionInterval, intervals: list[MotionInterval]) -> list[str]:
    remarks = []
    for interval in intervals:
        far = f"{1000 * interval.travel:.0f} mm"
        if interval.end <= slide.begin:
            remarks.append(
                f"{_how(interval)} {far}, {t[slide.begin] - t[interval.begin]:.2f} s before the hit"
            )
        elif interval.begin >= slide.end:
            remarks.append(f"{_how(interval)} {far}, {t[interval.begin] - t[slide.end]:.2f} s after its rest")
    return remarks


def _how(interval: MotionInterval) -> str:
    return "jumps" if interval.jump else "also moves"


def _start(t: Array, xy: Array, slide: MotionInterval, first: int) -> Array:
    before = np.flatnonzero(t[: slide.begin] >= t[slide.begin] - _START_WINDOW_S)
    before = before[before >= first]
    return np.median(xy[before], axis=0) if len(before) else xy[first]


def _dropped(reason: str) -> HitSegment:
    nowhere = np.full(2, np.nan)
    return HitSegment(0, -1, nowhere, nowhere, (), reason)
