"""What a diagnosis takes from a recording: the frames of every hit that slides, and where it started."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.slide.release_detection import moving_frames, noise_at_rest
from slapshot.diagnosis.pucks.slide.yaw import Turn, spins_seen, turn_of
from slapshot.recordings.format import Recording
from slapshot.recordings.motion_detection import find_motion_intervals, find_slide

RESTED_S = 6.0  # s after the release
AFTER_REST = 12  # frames at rest that are kept: more of them only repeat the rest point
_FEWEST_READINGS = 3  # of a hit's joints

# Why hits are not used.
NO_FRAMES = "there are no frames"
NO_REST_POINT = "there is no rest point"
NO_COMMAND = "there is no command"
NO_READINGS = "there are no joint readings, which other hits have"
ONE_COMMAND = "its command has a single row"
FEW_READINGS = "its joint readings are few, or cover less than half the time of those of other hits"
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
        starts_late, until = _one_motion(times, places)
        times, places, yaw = times[:until], places[:until], frames["yaw"].to_numpy(float)[:until]
        cut = moving_frames(times, places)
        if isinstance(cut, str):
            dropped[number] = cut
            continue
        begin, first, last = cut
        begin = 0 if starts_late else begin
        resting += [
            noise_at_rest(times, places, slice(0, begin)),
            noise_at_rest(times, places, slice(last, None)),
        ]
        used = slice(first, last + AFTER_REST)
        seen = np.median(places[:begin], axis=0) if begin >= 3 else np.full(2, np.nan)
        turns.append(turn_of(times, yaw, begin, first, last))
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


def _one_motion(times: Array, places: Array) -> tuple[bool, int]:
    """Whether an object slides in its first frame, and the frame at which it is moved once more."""
    motions = find_motion_intervals(times, places)
    slide = find_slide(motions)
    if slide is None:
        return False, len(times)
    later = [motion.begin for motion in motions if motion.begin >= slide.end and not motion.jump]
    return slide.begin == 0, min(later, default=len(times))


def hits_without_swing(recording: Recording) -> dict[int, str]:
    """Hits of which a table of the swing says too little, unlike of others -> why they cannot be used."""
    found: dict[int, str] = {}
    for table, why in ((recording.joints, NO_READINGS), (recording.commands, NO_COMMAND)):
        if table is not None:
            unheard = ~recording.hits["hit"].isin(table["hit"].unique())
            found |= dict.fromkeys(recording.hits.loc[unheard, "hit"].astype(int), why)
    if recording.commands is not None:
        rows = recording.commands.groupby("hit").size()
        found |= dict.fromkeys(rows.index[rows < 2].astype(int), ONE_COMMAND)
    if recording.joints is not None:
        # A swing is known over the time that the readings of all hits that are used cover.
        times = recording.joints.groupby("hit")["t"].agg(["size", "min", "max"])
        begin, end = times["min"].median(), times["max"].median()
        covers = times["max"].clip(upper=end) - times["min"].clip(lower=begin)
        few = (times["size"] < _FEWEST_READINGS) | (covers < (end - begin) / 2)
        found |= dict.fromkeys(times.index[few].astype(int), FEW_READINGS)
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
