"""What is odd in a recording though it is valid: `quality_warnings`.

A recording that `checks` passes can be read. Whether a diagnosis can trust it is another matter, and the
person who recorded it may mend much of it.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from slapshot.arrays import Array
from slapshot.recordings.format import Recording
from slapshot.recordings.frame_quality import odd_frames
from slapshot.recordings.plausibility import FARTHEST_M
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.swing_quality import odd_swings
from slapshot.recordings.track_features import HitTrack, hit_tracks, rest_noise, slide_table

# No arm hits so fast, and nothing slides with such friction: another unit of place or time.
_FASTEST_M_S, _ROUGHEST = 20.0, 2.0


def odd_places(recording: Recording) -> Iterator[QualityWarning]:
    """Places so far away that no table reaches there."""
    hits = recording.hits
    far = np.zeros(len(hits), dtype=bool)
    for point in ("start", "rest"):
        far |= np.hypot(hits[f"{point}_x"].to_numpy(), hits[f"{point}_y"].to_numpy()) > FARTHEST_M
    where = set(hits["hit"][far])
    frames = 0
    if recording.tracks is not None:
        away = recording.tracks[np.hypot(recording.tracks["x"], recording.tracks["y"]) > FARTHEST_M]
        frames = len(away)
        where |= set(away["hit"])
    if where:
        yield QualityWarning(
            "far_places",
            f"{int(far.sum())} start or rest points and {frames} frames lie more than {FARTHEST_M:g} m from "
            "the origin",
            tuple(sorted(map(int, where))),
            "no table is so large: a tracker that lost the object, or another unit",
        )


def odd_order(hits: pd.DataFrame, of: Literal["hit", "episode"] = "hit") -> Iterator[QualityWarning]:
    """Places in the order of execution that stand there twice, or contradict the dates.

    Args:
        hits: table of hits, or of episodes.
        of: which of them.
    """
    twice = hits[of][hits["order"].duplicated(keep=False)]
    if len(twice):
        yield QualityWarning(
            "order_repeats",
            f"{len(twice)} of {len(hits)} {of}s share their place in the order of execution with another",
            tuple(map(int, twice)),
            f"what drifts from {of} to {of} cannot be seen",
            of,
        )
    dated = hits[hits["recorded_at"].notna()].sort_values("order", kind="stable")
    back = dated[of][dated["recorded_at"].diff() < pd.Timedelta(0)]
    if len(back):
        yield QualityWarning(
            "order_dates",
            f"{len(back)} of {len(dated)} {of}s were recorded before the one that precedes them in the order",
            tuple(map(int, back)),
            "order or dates are wrong: drift and sessions are told by them",
            of,
        )


def odd_scale(slides: pd.DataFrame) -> Iterator[QualityWarning]:
    """Speeds and frictions that nothing has.

    Args:
        slides: slide_table of the hits.
    """
    speed, friction = slides["launch_speed"].median(), slides["friction"].median()
    if speed > _FASTEST_M_S or abs(friction) > _ROUGHEST:
        yield QualityWarning(
            "implausible_slides",
            f"objects start at {speed:.3g} m/s and slide with a friction of {friction:.3g} (medians)",
            (),
            "nothing does: places or times are in another unit, or the camera's rate is wrong",
        )


_FEW_HITS = 25  # at 50 hits the right effect comes first in two thirds of cases, below 25 in few
_NARROW_HEADINGS = np.deg2rad(30)
_ALIKE_SPEEDS = 0.1
_OFF_NOISE, _LEAST_OFF_M = 5.0, 0.005
_FRICTION_SPREAD, _LEAST_SPREAD = 3.0, 0.05  # times the fits' own error, and of the friction
_SURE = 0.01  # probability of so strong a correlation by chance
_CHANGES = 3.0  # standard errors
_THIRDS_HITS = 9
_SESSION_PAUSE = pd.Timedelta("30min")


def quality_warnings(recording: Recording) -> list[QualityWarning]:
    """Everything odd in a recording, as far as it can be seen without a model; empty if nothing is.

    Args:
        recording: that has passed its checks.
    """
    tracks = hit_tracks(recording)
    found = [*few_hits(recording.hits), *odd_order(recording.hits), *odd_places(recording)]
    found += odd_swings(recording)
    if tracks:
        slides = slide_table(tracks)
        found += odd_scale(slides)
        found += odd_frames(tracks, slides, recording.camera_rate_hz)
        found += odd_motion(tracks)
        found += odd_ends(tracks, recording.hits)
        found += odd_variety(slides)
        found += odd_friction(slides, recording.hits)
    return found


def few_hits(hits: pd.DataFrame) -> Iterator[QualityWarning]:
    """Too few hits to name anything."""
    if len(hits) < _FEW_HITS:
        yield QualityWarning(
            "few_hits",
            f"only {len(hits)} hits",
            (),
            "what small effects do cannot be told from hit-to-hit scatter with so few; aim for 50 and more",
        )


def odd_motion(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Hits that never move, move from the start, are pushed twice, or move again."""
    still = tuple(track.hit for track in tracks if track.slide is None)
    if still:
        yield QualityWarning(
            "never_moves",
            f"{len(still)} of {len(tracks)} hits never move",
            still,
            "a miss is no slide: leave it out, or friction and noise are estimated from nothing",
        )
    moving = [track for track in tracks if track.slide is not None]
    begun = tuple(track.hit for track in moving if track.slide is not None and track.slide.begin == 0)
    if begun:
        yield QualityWarning(
            "moving_at_start",
            f"{len(begun)} of {len(tracks)} hits move in their first frame",
            begun,
            "the launch was not seen, and neither noise at rest nor the start error can be told",
        )
    ends = tuple(t.hit for t in moving if t.slide is not None and t.slide.end >= len(t.t))
    if ends:
        yield QualityWarning(
            "moving_at_end",
            f"{len(ends)} of {len(tracks)} hits still move in their last frame",
            ends,
            "where they came to rest is not known: the slow end, which tells friction best, is missing",
        )
    pushed = tuple(track.hit for track in moving if len(track.pushes) > 1)
    if pushed:
        yield QualityWarning(
            "second_push",
            f"in {len(pushed)} of {len(tracks)} hits the speed rises again after its first peak",
            pushed,
            "the arm pushed or hit a second time: only what follows the last push is a slide",
        )
    again = tuple(track.hit for track in moving if sum(not e.jump for e in track.episodes) > 1)
    if again:
        yield QualityWarning(
            "moves_again",
            f"{len(again)} of {len(tracks)} hits move more than once",
            again,
            "a nudge before the hit or a hand after it; crop the tracks to the slide",
        )


def odd_ends(tracks: list[HitTrack], hits: pd.DataFrame) -> Iterator[QualityWarning]:
    """Start and rest points in the table of hits that are not those of the track."""
    table = hits.set_index("hit")
    for point, word, remedy, seen in (
        (
            "start",
            "first frames",
            "the start error must be fitted",
            {track.hit: track.before for track in tracks},
        ),
        (
            "rest",
            "end",
            "track and rest point cannot both be fitted",
            {track.hit: track.after for track in tracks},
        ),
    ):
        off = {}
        for track in tracks:
            frames = seen[track.hit][-10:] if point == "start" else seen[track.hit]
            given = table.loc[track.hit, [f"{point}_x", f"{point}_y"]].to_numpy(np.float64)
            if len(frames) < 3 or np.isnan(given).any():
                continue
            apart = float(np.linalg.norm(given - np.median(frames, axis=0)))
            if apart > max(_OFF_NOISE * np.nan_to_num(rest_noise(track)), _LEAST_OFF_M):
                off[track.hit] = apart
        if off:
            yield QualityWarning(
                "start_point" if point == "start" else "rest_point",
                f"in {len(off)} of {len(tracks)} hits the {point} point is not the track's {word}: "
                f"{1000 * np.median(list(off.values())):.0f} mm off (median), up to "
                f"{1000 * max(off.values()):.0f} mm",
                tuple(off),
                f"it is where the object was meant to lie, or of another moment or frame: {remedy}",
            )


def odd_variety(slides: pd.DataFrame) -> Iterator[QualityWarning]:
    """Headings or speeds that are all alike."""
    if len(slides) < 3:
        return
    heading = slides["heading"].to_numpy()
    low, high = np.quantile(_centred(heading), [0.05, 0.95])
    if high - low < _NARROW_HEADINGS:
        yield QualityWarning(
            "alike_headings",
            f"headings span {np.rad2deg(high - low):.0f} degrees (90 % of hits)",
            (),
            "tilt along the heading looks like friction, and place like distance: diverse headings are worth "
            "more than more hits",
        )
    speed = slides["launch_speed"]
    if speed.std() < _ALIKE_SPEEDS * speed.mean():
        yield QualityWarning(
            "alike_speeds",
            f"launch speeds are all alike: {speed.mean():.2g} m/s +- {speed.std() / speed.mean():.0%}",
            (),
            "drag and friction that changes with speed cannot be told from plain friction",
        )


def odd_friction(slides: pd.DataFrame, hits: pd.DataFrame) -> Iterator[QualityWarning]:
    """Friction that differs from hit to hit by more than its error, or changes within the slide."""
    if len(slides) < 5:
        return
    friction, error = slides["friction"], float(slides["friction_se"].median())
    object_of = hits.set_index("hit")["object_id"].loc[slides["hit"]].to_numpy()
    spread = float(1.4826 * (friction - friction.groupby(object_of).transform("median")).abs().median())
    negative = slides.loc[friction <= 0, "hit"]
    if len(negative):
        yield QualityWarning(
            "not_slowing",
            f"{len(negative)} of {len(slides)} hits do not slow down after their last push",
            tuple(negative.astype(int)),
            "something drives them, or the track is too short or noisy to tell",
        )
    if spread > max(_FRICTION_SPREAD * error, _LEAST_SPREAD * abs(float(friction.median()))):
        low, high = friction.quantile([0.05, 0.95])
        yield QualityWarning(
            "scatter",
            f"friction differs from hit to hit: {friction.median():.3f} (median), {low:.3f} to {high:.3f} "
            f"(90 % of hits), {spread / error:.0f} times the fits' own error{_by_group(slides, hits)}; it "
            f"goes with {_goes_with(slides, hits)}",
            (),
            "if it follows something it is no hit-to-hit scatter; of what it follows, these hits cannot part "
            "what went together in them",
        )
    change = slides["late_friction"] / friction - 1
    change = change[np.isfinite(change)]
    middle = float(change.median())
    error = 1.25 * 1.4826 * float((change - middle).abs().median()) / np.sqrt(max(len(change), 1))
    if abs(middle) > max(_CHANGES * error, _LEAST_SPREAD):
        yield QualityWarning(
            "friction_changes",
            f"friction is {middle:+.0%} in the slower half of the slide (median over hits, +- {error:.0%})",
            (),
            "friction that follows speed, drag, or a place that differs: plain friction leaves this behind",
        )


def _goes_with(slides: pd.DataFrame, hits: pd.DataFrame) -> str:
    """What friction is correlated with more than chance would have it, the strongest first."""
    table = slides.merge(hits[["hit", "order"]], on="hit")
    table["heading"] = _centred(table["heading"].to_numpy())
    words = {
        "launch_speed": "speed",
        "heading": "heading",
        "x": "place x",
        "y": "place y",
        "order": "order",
    }
    found = []
    for column, word in words.items():
        if np.ptp(table[column].to_numpy()) > 0:
            rank = spearmanr(table[column], table["friction"])
            if rank.pvalue < _SURE:
                found.append((abs(rank.statistic), f"{word} (rank correlation {rank.statistic:+.2f})"))
    strongest = [text for _, text in sorted(found, reverse=True)]
    return ", ".join(strongest) or "none of speed, heading, place and order"


def _by_group(slides: pd.DataFrame, hits: pd.DataFrame) -> str:
    """Medians by thirds of heading, by session if the hits have dates, and by object; in words."""
    table = slides.merge(hits[["hit", "object_id", "recorded_at"]], on="hit")
    groups = {"object": table["object_id"]}
    if table["recorded_at"].notna().all():
        when = table["recorded_at"].sort_values()
        groups["session"] = ((when.diff() > _SESSION_PAUSE).cumsum() + 1).reindex(table.index)
    heading = np.rad2deg(_centred(table["heading"].to_numpy()) + _middle(table["heading"].to_numpy()))
    if np.ptp(heading) > np.rad2deg(_NARROW_HEADINGS) and len(table) >= _THIRDS_HITS:
        thirds = pd.qcut(pd.Series(heading), 3, precision=0, duplicates="drop")
        names = [f"{third.left:.0f} to {third.right:.0f} degrees" for third in thirds.cat.categories]
        groups["heading"] = thirds.cat.rename_categories(names)
    texts = []
    for name, group in groups.items():
        medians = table["friction"].groupby(group, observed=True).median()
        if len(medians) > 1:
            each = ", ".join(f"{label} {value:.3f}" for label, value in medians.items())
            texts.append(f"; by {name}: {each}")
    return "".join(texts)


def _middle(heading: Array) -> float:
    """Circular mean in rad."""
    return float(np.angle(np.exp(1j * heading).mean()))


def _centred(heading: Array) -> Array:
    """Headings in rad from their circular mean, so that no circle is cut in the middle of them."""
    return np.angle(np.exp(1j * (heading - _middle(heading))))
