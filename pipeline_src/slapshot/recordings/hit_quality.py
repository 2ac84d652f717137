"""What is odd in a recording's places, scales and order of hits."""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import pandas as pd

from slapshot.recordings.format import Recording
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.units import FARTHEST_M

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
