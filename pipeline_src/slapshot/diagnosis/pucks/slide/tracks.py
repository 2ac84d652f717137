"""What a diagnosis takes from a recording: the frames of every hit that slides, and where it started."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.slide.yaw import Turn, spins_seen, turn_of
from slapshot.recordings.format import Recording

# m from the start at which a striker has let go, unless the object still gains speed: contact lasts for
# 3 to 8 cm.
RELEASE_DISTANCE = 0.12
SPEED_FRAMES = 4  # fewest of a piece of a way whose acceleration is told
FASTER = 4.0  # sd by which an acceleration must exceed 0 to be that of a push
MOVING_DISTANCE = 0.02  # m from the start at which an object has begun to move, above any camera's noise
FEWEST_FRAMES = 8  # of a slide that is used
RESTED_S = 6.0  # s after the release
AFTER_REST = 12  # frames at rest that are kept: more of them only repeat the rest point

# Why hits are not used.
NO_FRAMES = "there are no frames"
NO_REST_POINT = "there is no rest point"
NO_COMMAND = "there is no command"
NO_READINGS = "there are no joint readings, which other hits have"
TOO_FEW_FRAMES = "there are too few frames"
TOO_SHORT_A_WAY = f"the object moved by less than {100 * RELEASE_DISTANCE:.0f} cm"
TOO_SHORT_A_SLIDE = f"the object was seen to slide for less than {FEWEST_FRAMES} frames"
NEVER_RESTED = "the object was still moving when the camera stopped"
PUSHED_AGAIN = "the speed rose again after its first peak, as if the object was pushed or hit a second time"


@dataclass(frozen=True)
class HitTracks:
    """n hits whose slide was seen; frames in arrays padded to the longest hit.

    Attributes:
        hit: (n,) number of the hit.
        object: (n,) index into objects.
        objects: object_id of each.
        order: (n,) place in the recording, from -1/2 to 1/2.
        command: (n,) number of the command; equal for repeats.
        start: (n, 2) m, where the object was meant to lie.
        seen_start: (n, 2) m, median of the frames before it moved; NaN if there are none.
        release: (n,) s, time of the first frame that is used; NaN where nobody saw it.
        times: (n, frames) s since the release.
        places: (n, frames, 2) m.
        valid: (n, frames) which of them are frames.
        turned: (n,) rad by which objects turned between being struck and the release; 0 if nobody knows.
        turn_seen: (n,) whether that was seen.
        spin: (n,) rad/s at the release, by the yaw that was recorded.
        spin_sd: (n,) rad/s, its standard error; infinite where nobody saw it.
        resting: residuals (m, 2) in m from their mean and time since the frame before (m,) in s, of frames
            at rest, one hit after another; the interval is infinite for a hit's first.
        dropped: hits that are not used -> why.
    """

    hit: NDArray[np.int64]
    object: NDArray[np.int64]
    objects: tuple[str, ...]
    order: Array
    command: NDArray[np.int64]
    start: Array
    seen_start: Array
    release: Array
    times: Array
    places: Array
    valid: NDArray[np.bool_]
    turned: Array
    turn_seen: NDArray[np.bool_]
    spin: Array
    spin_sd: Array
    resting: tuple[Array, Array]
    dropped: dict[int, str]

    def __len__(self) -> int:
        return len(self.hit)

    def take(self, rows: NDArray[np.int64]) -> "HitTracks":
        """Some of the hits."""
        names = (
            *("hit", "object", "order", "command", "start", "seen_start", "release"),
            *("turned", "turn_seen", "spin", "spin_sd", "times", "places", "valid"),
        )
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def notes(self) -> tuple[str, ...]:
        """Hits that are not used, a line for each reason."""
        reasons = Counter(self.dropped.values())
        return tuple(
            f"{'1 hit was' if count == 1 else f'{count} hits were'} left out because {why}"
            for why, count in sorted(reasons.items())
        )


def hit_tracks(recording: Recording, left_out: Mapping[int, str] | None = None) -> HitTracks:
    """Cut the slides out of a recording that has tracks.

    Args:
        recording: with tracks.
        left_out: numbers of hits that are not to be used -> why.
    """
    assert recording.tracks is not None
    groups = dict(tuple(recording.tracks.groupby("hit")))
    rows: list[tuple[pd.Series, Array, Array, float, Array]] = []
    resting: list[tuple[Array, Array]] = []
    turns: list[Turn] = []
    dropped: dict[int, str] = {}
    ordered = recording.hits.sort_values("order")
    for _, hit in ordered.iterrows():
        number = int(hit["hit"])
        if left_out and number in left_out:
            dropped[number] = left_out[number]
            continue
        frames = groups.get(number)
        if frames is None:
            dropped[number] = NO_FRAMES
            continue
        times, places = frames["t"].to_numpy(), frames[["x", "y"]].to_numpy()
        cut = _cut(times, places)
        if isinstance(cut, str):
            dropped[number] = cut
            continue
        begin, first, last = cut
        resting += [_at_rest(times, places, slice(0, begin)), _at_rest(times, places, slice(last, None))]
        used = slice(first, last + AFTER_REST)
        seen = np.median(places[:begin], axis=0) if begin >= 3 else np.full(2, np.nan)
        turns.append(turn_of(times, frames["yaw"].to_numpy(float), begin, first, last))
        rows.append((hit, seen, times[used] - times[first], times[first], places[used]))
    longest = max((len(r[2]) for r in rows), default=1)
    count = len(rows)
    times, places = np.zeros((count, longest)), np.zeros((count, longest, 2))
    valid = np.zeros((count, longest), bool)
    for i, (_, _, t, _, p) in enumerate(rows):
        times[i, : len(t)], places[i, : len(t)], valid[i, : len(t)] = t, p, True
        times[i, len(t) :] = t[-1]
    pairs = [r for r in resting if len(r[0])]
    turned, (spin, spin_sd) = np.array([turn.turned for turn in turns]), spins_seen(turns)
    return HitTracks(
        **_of_hits(recording, pd.DataFrame([r[0] for r in rows], columns=recording.hits.columns)),
        seen_start=np.array([r[1] for r in rows]).reshape(-1, 2),
        release=np.array([r[3] for r in rows]),
        times=times,
        places=places,
        valid=valid,
        turned=np.nan_to_num(turned),
        turn_seen=np.isfinite(turned),
        spin=spin,
        spin_sd=spin_sd,
        resting=(
            np.concatenate([p[0] for p in pairs]) if pairs else np.zeros((0, 2)),
            np.concatenate([p[1] for p in pairs]) if pairs else np.zeros(0),
        ),
        dropped=dropped,
    )


def hits_without_swing(recording: Recording) -> dict[int, str]:
    """Hits of which a table of the swing says nothing while it does of others -> why they cannot be used."""
    found: dict[int, str] = {}
    for table, why in ((recording.joints, NO_READINGS), (recording.commands, NO_COMMAND)):
        if table is not None:
            unheard = ~recording.hits["hit"].isin(table["hit"].unique())
            found |= dict.fromkeys(recording.hits.loc[unheard, "hit"].astype(int), why)
    return found


def rest_tracks(recording: Recording, left_out: Mapping[int, str] | None = None) -> HitTracks:
    """Rest points as tracks of one frame each, long after the hit; nobody saw when objects were released.

    Args:
        recording: with rest points.
        left_out: numbers of hits that are not to be used -> why.
    """
    ordered = recording.hits.sort_values("order")
    dropped = dict(left_out or {})
    rested = ordered[["rest_x", "rest_y"]].notna().all(axis=1)
    dropped |= dict.fromkeys(ordered.loc[~rested, "hit"].astype(int), NO_REST_POINT)
    hits = ordered[~ordered["hit"].isin(list(dropped))]
    count = len(hits)
    return HitTracks(
        **_of_hits(recording, hits),
        seen_start=np.full((count, 2), np.nan),
        release=np.full(count, np.nan),
        times=np.full((count, 1), RESTED_S),
        places=hits[["rest_x", "rest_y"]].to_numpy(float)[:, None],
        valid=np.ones((count, 1), bool),
        turned=np.zeros(count),
        turn_seen=np.zeros(count, bool),
        spin=np.zeros(count),
        spin_sd=np.full(count, np.inf),
        resting=(np.zeros((0, 2)), np.zeros(0)),
        dropped=dropped,
    )


def _of_hits(recording: Recording, hits: pd.DataFrame) -> dict[str, Any]:
    """What hits.parquet says of some of its hits."""
    objects = tuple(recording.objects)
    orders = recording.hits["order"].to_numpy(float)
    command = hits["command_id"].astype("Float64").to_numpy(float, na_value=np.nan)
    own = -1 - np.arange(len(hits))
    return {
        "hit": hits["hit"].to_numpy(np.int64),
        "object": np.array([objects.index(o) for o in hits["object_id"]], np.int64),
        "objects": objects,
        "order": (hits["order"].to_numpy(float) - orders.min()) / max(np.ptp(orders), 1.0) - 0.5,
        "command": np.where(np.isnan(command), own, command).astype(np.int64),
        "start": hits[["start_x", "start_y"]].to_numpy(float),
    }


def _cut(times: Array, places: Array) -> tuple[int, int, int] | str:
    """Rows at which motion begins, the object is released, and it rests; or why the hit cannot be used."""
    if len(times) < FEWEST_FRAMES:
        return TOO_FEW_FRAMES
    smooth = _running_median(places)
    end = np.median(places[-FEWEST_FRAMES:], axis=0)
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


def _at_rest(times: Array, places: Array, rows: slice) -> tuple[Array, Array]:
    """Residuals from the median (without mistracks) and intervals, but for the last frame before motion."""
    part, when = places[rows][:-1], times[rows][:-1]
    if len(part) < 4:
        return np.zeros((0, 2)), np.zeros(0)
    residual = part - np.median(part, axis=0)
    good = (np.abs(residual) < 6 * 1.4826 * np.median(np.abs(residual), axis=0) + 1e-9).all(1)
    return residual[good] - residual[good].mean(0), np.concatenate([[np.inf], np.diff(when[good])])
