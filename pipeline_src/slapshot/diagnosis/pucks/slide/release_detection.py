"""Where, in the frames of a hit, an object begins to move, is released by the striker, and rests."""

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array

# m from the start at which a striker has let go, unless the object still gains speed: contact lasts for
# 3 to 8 cm.
RELEASE_DISTANCE = 0.12
SPEED_FRAMES = 4  # fewest of a piece of a way whose acceleration is told
FASTER = 4.0  # sd by which an acceleration must exceed 0 to be that of a push
MOVING_DISTANCE = 0.02  # m from the start at which an object has begun to move, above any camera's noise
FEWEST_FRAMES = 8  # of a slide that is used
_REST_S = 0.1  # s, shortest time at the end in which an object may not move

# Why hits are not used.
TOO_FEW_FRAMES = "there are too few frames"
TOO_SHORT_A_WAY = f"the object moved by less than {100 * RELEASE_DISTANCE:.0f} cm"
TOO_SHORT_A_SLIDE = f"the object was seen to slide for less than {FEWEST_FRAMES} frames"
NEVER_RESTED = "the object was still moving when the camera stopped"


def moving_frames(times: Array, places: Array) -> tuple[int, int, int] | str:
    """Rows at which motion begins, the object is released, and it rests; or why the hit cannot be used."""
    if len(times) < FEWEST_FRAMES:
        return TOO_FEW_FRAMES
    smooth = _running_median(places)
    # A fast camera sees a moving object in nearly the same place for many frames.
    still = max(FEWEST_FRAMES, int(np.sum(times > times[-1] - _REST_S)))
    end = np.median(places[-still:], axis=0)
    origin = np.median(smooth[:3], axis=0)
    away = np.linalg.norm(smooth - origin, axis=1)
    if away.max() < RELEASE_DISTANCE:
        return TOO_SHORT_A_WAY
    # From the end backwards: a mistrack at rest is no beginning.
    begin = _last(away <= MOVING_DISTANCE) + 1
    # Chosen by its own noise, the first frame that is farther away would be too far ahead on average: whether
    # one is, is told by frames before it.
    foreseen = away[2:-1] + (away[2:-1] - away[:-3]) / 2
    first = _last(foreseen <= RELEASE_DISTANCE) + 4
    # Two frames later friction has stopped it.
    if np.linalg.norm(np.median(smooth[-3:], axis=0) - end) > MOVING_DISTANCE / 2:
        return NEVER_RESTED
    # The last two frames have no median of five.
    moves = _last(np.linalg.norm(smooth[:-2] - end, axis=1) > MOVING_DISTANCE / 2) + 1
    last = moves + 2
    if last < len(times) - FEWEST_FRAMES:
        noise = max(_noise(places[first:last]), _noise(places[last:]))
        first = _slows_down(times[:moves], smooth[:moves], first, noise)
    if last - first < FEWEST_FRAMES:
        return TOO_SHORT_A_SLIDE
    if last >= len(times):
        return NEVER_RESTED
    return begin, first, last


def _slows_down(times: Array, smooth: Array, first: int, sd: float) -> int:
    """Row, `first` or later, at which a striker ceases to push; places have noise of `sd` in m.

    Two pieces of constant acceleration along the way, joined without a jump of the speed, are fitted. What
    gains speed in the first one is pushed until its end; what gains speed after it lost some is pulled by
    something else than the striker.
    """
    if len(times) - first < FEWEST_FRAMES:
        return first
    t, ways = times[first:] - times[first], smooth[first:] - smooth[first]
    farthest = ways[int(np.argmax((ways**2).sum(1)))]
    way = ways @ (farthest / max(float(np.linalg.norm(farthest)), 1e-9))
    if not _may_gain_speed(t, way, sd):
        return first
    parabola = np.stack([np.ones_like(t), t, t**2 / 2], axis=1)
    best, until = np.inf, first
    for k in range(SPEED_FRAMES, len(t) - SPEED_FRAMES):
        design = np.column_stack([parabola, np.maximum(t - t[k], 0) ** 2 / 2])
        fitted, _, rank, _ = np.linalg.lstsq(design, way, rcond=None)
        square = float(((way - design @ fitted) ** 2).sum())
        if rank < design.shape[1] or square >= best:
            continue
        error = sd * np.sqrt(np.linalg.inv(design.T @ design)[2, 2])
        pushes = fitted[2] > FASTER * error and fitted[2] + fitted[3] < 0
        best, until = square, first + k if pushes else first
    return until


def _may_gain_speed(t: Array, way: Array, sd: float) -> bool:
    """Whether any beginning of a way, in m, is not surely one that slows down: most are, at little cost."""
    for count in range(FEWEST_FRAMES, len(t) + 1, SPEED_FRAMES):
        design = np.stack([np.ones(count), t[:count], t[:count] ** 2 / 2], axis=1)
        covariance = np.linalg.inv(design.T @ design)
        acceleration = covariance[2] @ (design.T @ way[:count])
        if acceleration + 2 * sd * np.sqrt(covariance[2, 2]) > 0:
            return True
        if sd * np.sqrt(covariance[2, 2]) < -acceleration / 10:
            return False
    return False


def _noise(places: Array) -> float:
    """Sd in m of noise in places (frames, 2) that else move smoothly; frames at wrong times add to it."""
    if len(places) < 4:
        return np.inf
    thirds = np.diff(places, n=3, axis=0) / np.sqrt(20)
    return float(1.4826 * np.median(np.abs(thirds), axis=0).max())


def _last(condition: NDArray[np.bool_]) -> int:
    """Last row where it holds; -1 if there is none."""
    rows = np.flatnonzero(condition)
    return int(rows[-1]) if len(rows) else -1


def _running_median(places: Array) -> Array:
    """Of five frames, against mistracks; an object passes its places in order, and is not changed by it."""
    padded = np.concatenate([places[:1], places[:1], places, places[-1:], places[-1:]])
    return np.median(np.stack([padded[k : k + len(places)] for k in range(5)]), axis=0)


def noise_at_rest(times: Array, places: Array, rows: slice) -> tuple[Array, Array]:
    """Residuals from the median (without mistracks) and intervals, but for the last frame before motion."""
    part, when = places[rows][:-1], times[rows][:-1]
    if len(part) < 4:
        return np.zeros((0, 2)), np.zeros(0)
    residual = part - np.median(part, axis=0)
    good = (np.abs(residual) < 6 * 1.4826 * np.median(np.abs(residual), axis=0) + 1e-9).all(1)
    return residual[good] - residual[good].mean(0), np.concatenate([[np.inf], np.diff(when[good])])
