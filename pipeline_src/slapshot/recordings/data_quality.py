"""Quality warnings for a valid recording: `quality_warnings`.

A recording that passes `checks` can be read. The warnings concern whether a diagnosis can rely on it, and
most of them can be fixed by whoever recorded it.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from slapshot.arrays import Array
from slapshot.recordings.format import Recording
from slapshot.recordings.frame_quality import frame_warnings
from slapshot.recordings.plausibility import FARTHEST_M
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.swing_quality import swing_warnings
from slapshot.recordings.track_features import HitTrack, hit_tracks, rest_noise, slide_table

# No arm hits this fast and nothing slides with such friction: the unit of length or time is wrong.
_FASTEST_M_S, _ROUGHEST = 20.0, 2.0


def range_warnings(recording: Recording) -> Iterator[QualityWarning]:
    """Positions too far away for any table."""
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
            "no table is that large: the tracker lost the object, or the unit is wrong",
        )


def order_warnings(hits: pd.DataFrame, of: Literal["hit", "episode"] = "hit") -> Iterator[QualityWarning]:
    """Duplicate values of the order of execution, and an order that contradicts the dates.

    Args:
        hits: table of hits, or of episodes.
        of: which of them.
    """
    twice = hits[of][hits["order"].duplicated(keep=False)]
    if len(twice):
        yield QualityWarning(
            "order_repeats",
            f"{len(twice)} of {len(hits)} {of}s have the same order of execution as another",
            tuple(map(int, twice)),
            f"drift from {of} to {of} cannot be detected",
            of,
        )
    dated = hits[hits["recorded_at"].notna()].sort_values("order", kind="stable")
    back = dated[of][dated["recorded_at"].diff() < pd.Timedelta(0)]
    if len(back):
        yield QualityWarning(
            "order_dates",
            f"{len(back)} of {len(dated)} {of}s were recorded before the one that precedes them in the order",
            tuple(map(int, back)),
            "order or dates are wrong: drift and sessions are inferred from them",
            of,
        )


def implausible_slide_warnings(slides: pd.DataFrame) -> Iterator[QualityWarning]:
    """Implausible speeds and friction coefficients.

    Args:
        slides: slide_table of the hits.
    """
    speed, friction = slides["launch_speed"].median(), slides["friction"].median()
    if speed > _FASTEST_M_S or abs(friction) > _ROUGHEST:
        yield QualityWarning(
            "implausible_slides",
            f"objects start at {speed:.3g} m/s and slide with a friction of {friction:.3g} (medians)",
            (),
            "implausible: positions or times are in another unit, or the camera rate is wrong",
        )


_RECOMMENDED_HITS = 25  # with 50 hits the right effect ranks first in two thirds of cases, below 25 rarely
_MIN_HEADING_RANGE = np.deg2rad(30)
_MIN_SPEED_SPREAD = 0.1
_OFF_NOISE, _MIN_OFFSET_M = 5.0, 0.005
_FRICTION_SPREAD, _MIN_SPREAD = 3.0, 0.05  # times the fits' own error, and of the friction
_SIGNIFICANT = 0.01  # significance level of a correlation
_CHANGES = 3.0  # standard errors
_THIRDS_HITS = 9
_SESSION_PAUSE = pd.Timedelta("30min")


def quality_warnings(recording: Recording) -> list[QualityWarning]:
    """All quality warnings that need no model; empty if there are none.

    Args:
        recording: that has passed its checks.
    """
    tracks = hit_tracks(recording)
    found = [
        *sample_size_warnings(recording.hits),
        *order_warnings(recording.hits),
        *range_warnings(recording),
    ]
    found += swing_warnings(recording)
    if tracks:
        slides = slide_table(tracks)
        found += implausible_slide_warnings(slides)
        found += frame_warnings(tracks, slides, recording.camera_rate_hz)
        found += motion_warnings(tracks)
        found += endpoint_warnings(tracks, recording.hits)
        found += diversity_warnings(slides)
        found += friction_warnings(slides, recording.hits)
    return found


def sample_size_warnings(hits: pd.DataFrame) -> Iterator[QualityWarning]:
    """Too few hits to identify an effect."""
    if len(hits) < _RECOMMENDED_HITS:
        yield QualityWarning(
            "few_hits",
            f"only {len(hits)} hits",
            (),
            "with so few hits, small effects cannot be distinguished from hit-to-hit scatter; aim for 50 "
            "or more",
        )


def motion_warnings(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Hits without motion, moving from the first frame, pushed twice, or moving again."""
    still = tuple(track.hit for track in tracks if track.slide is None)
    if still:
        yield QualityWarning(
            "never_moves",
            f"{len(still)} of {len(tracks)} hits never move",
            still,
            "a miss is not a slide: exclude it, or friction and noise are estimated from nothing",
        )
    moving = [track for track in tracks if track.slide is not None]
    begun = tuple(track.hit for track in moving if track.slide is not None and track.slide.begin == 0)
    if begun:
        yield QualityWarning(
            "moving_at_start",
            f"{len(begun)} of {len(tracks)} hits move in their first frame",
            begun,
            "the launch was not recorded, so neither noise at rest nor the start error can be estimated",
        )
    ends = tuple(t.hit for t in moving if t.slide is not None and t.slide.end >= len(t.t))
    if ends:
        yield QualityWarning(
            "moving_at_end",
            f"{len(ends)} of {len(tracks)} hits still move in their last frame",
            ends,
            "their rest points are unknown: the slow end, which is most informative about friction, is "
            "missing",
        )
    pushed = tuple(track.hit for track in moving if len(track.pushes) > 1)
    if pushed:
        yield QualityWarning(
            "second_push",
            f"in {len(pushed)} of {len(tracks)} hits the speed rises again after its first peak",
            pushed,
            "the arm pushed or hit a second time: only the motion after the last push is a slide",
        )
    again = tuple(track.hit for track in moving if sum(not e.jump for e in track.motion_intervals) > 1)
    if again:
        yield QualityWarning(
            "moves_again",
            f"{len(again)} of {len(tracks)} hits move more than once",
            again,
            "a nudge before the hit or a hand after it; crop the tracks to the slide",
        )


def endpoint_warnings(tracks: list[HitTrack], hits: pd.DataFrame) -> Iterator[QualityWarning]:
    """Start and rest points in the table of hits that differ from those of the track."""
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
            if apart > max(_OFF_NOISE * np.nan_to_num(rest_noise(track)), _MIN_OFFSET_M):
                off[track.hit] = apart
        if off:
            yield QualityWarning(
                "start_point" if point == "start" else "rest_point",
                f"in {len(off)} of {len(tracks)} hits the {point} point is not the track's {word}: "
                f"{1000 * np.median(list(off.values())):.0f} mm off (median), up to "
                f"{1000 * max(off.values()):.0f} mm",
                tuple(off),
                f"it is a nominal position, or from another time or coordinate frame: {remedy}",
            )


def diversity_warnings(slides: pd.DataFrame) -> Iterator[QualityWarning]:
    """Headings or speeds with too little variation."""
    if len(slides) < 3:
        return
    heading = slides["heading"].to_numpy()
    low, high = np.quantile(_centred(heading), [0.05, 0.95])
    if high - low < _MIN_HEADING_RANGE:
        yield QualityWarning(
            "alike_headings",
            f"headings span {np.rad2deg(high - low):.0f} degrees (90 % of hits)",
            (),
            "tilt along the heading is confounded with friction, and position with distance: diverse "
            "headings "
            "help more than more hits",
        )
    speed = slides["launch_speed"]
    if speed.std() < _MIN_SPEED_SPREAD * speed.mean():
        yield QualityWarning(
            "alike_speeds",
            f"launch speeds are all alike: {speed.mean():.2g} m/s +- {speed.std() / speed.mean():.0%}",
            (),
            "drag and speed-dependent friction cannot be distinguished from Coulomb friction",
        )


def friction_warnings(slides: pd.DataFrame, hits: pd.DataFrame) -> Iterator[QualityWarning]:
    """Friction that varies between hits by more than its error, or changes within the slide."""
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
            "something drives them, or the track is too short or noisy",
        )
    if spread > max(_FRICTION_SPREAD * error, _MIN_SPREAD * abs(float(friction.median()))):
        low, high = friction.quantile([0.05, 0.95])
        yield QualityWarning(
            "scatter",
            f"friction differs from hit to hit: {friction.median():.3f} (median), {low:.3f} to {high:.3f} "
            f"(90 % of hits), {spread / error:.0f} times the fits' own error{_by_group(slides, hits)}; "
            f"correlated with {_goes_with(slides, hits)}",
            (),
            "a dependence is not hit-to-hit scatter; variables that are correlated in these hits cannot be "
            "separated",
        )
    change = slides["late_friction"] / friction - 1
    change = change[np.isfinite(change)]
    middle = float(change.median())
    error = 1.25 * 1.4826 * float((change - middle).abs().median()) / np.sqrt(max(len(change), 1))
    if abs(middle) > max(_CHANGES * error, _MIN_SPREAD):
        yield QualityWarning(
            "friction_changes",
            f"friction is {middle:+.0%} in the slower half of the slide (median over hits, +- {error:.0%})",
            (),
            "speed-dependent friction, drag or position-dependent friction: Coulomb friction does not "
            "explain it",
        )


def _goes_with(slides: pd.DataFrame, hits: pd.DataFrame) -> str:
    """Variables that friction is significantly correlated with, the strongest first."""
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
            if rank.pvalue < _SIGNIFICANT:
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
    if np.ptp(heading) > np.rad2deg(_MIN_HEADING_RANGE) and len(table) >= _THIRDS_HITS:
        thirds = pd.qcut(pd.Series(heading), 3, precision=0, duplicates="drop")
        digits = next(n for n in range(10) if len(set(_ranges(thirds, n))) == len(thirds.cat.categories))
        groups["heading"] = thirds.cat.rename_categories(_ranges(thirds, digits))
    texts = []
    for name, group in groups.items():
        medians = table["friction"].groupby(group, observed=True).median()
        if len(medians) > 1:
            each = ", ".join(f"{label} {value:.3f}" for label, value in medians.items())
            texts.append(f"; by {name}: {each}")
    return "".join(texts)


def _ranges(intervals: pd.Series, digits: int) -> list[str]:
    """Categories that are intervals of headings, in words."""
    return [f"{one.left:.{digits}f} to {one.right:.{digits}f} degrees" for one in intervals.cat.categories]


def _middle(heading: Array) -> float:
    """Circular mean in rad."""
    return float(np.angle(np.exp(1j * heading).mean()))


def _centred(heading: Array) -> Array:
    """Headings in rad relative to their circular mean, which avoids a wrap-around within the data."""
    return np.angle(np.exp(1j * (heading - _middle(heading))))
