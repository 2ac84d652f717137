"""Plausibility of units: values far beyond any rig are millimetres, degrees, milliseconds or grams.

Checks of units use the median, since a camera that loses the object may report a few absurd positions, and
raise InputError with one line that says how to convert. `check_possible` checks each value.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.errors import InputError
from slapshot.recordings.format import HEADER_FILE

# No arm hits an object farther than a hall is long, and no revolute joint rests two turns from 0.
FARTHEST_M = 20.0
LARGEST_ANGLE_RAD = 4 * np.pi
LONGEST_SWING_S = 100.0
LATEST_BEGIN_S = 100.0
# Bounds beyond what a tracker that lost its object, a clock that jumped or an encoder that slipped reports.
IMPOSSIBLE_M, IMPOSSIBLE_S = 1e6, 1e4
IMPOSSIBLE_YAW_RAD, IMPOSSIBLE_JOINT_RAD = 1e4, 100.0
FRAME_INTERVAL_FACTOR = 10.0
EARLIEST, LATEST = pd.Timestamp("1990-01-01", tz="UTC"), pd.Timestamp("2100-01-01", tz="UTC")

_MILLIMETRES = "if these are millimetres, divide by 1000 (centimetres: by 100)"


def check_possible(
    table: pd.DataFrame, columns: Sequence[str], limit: float, what: str, file: Path, of: str = "hit"
) -> None:
    """Refuse impossible single values, such as uninitialised memory.

    Args:
        table: With a column `of`.
        columns: To check; NaN passes.
        limit: Largest size that a value may have.
        what: They are, with the unit, for the message.
        file: Named in errors.
        of: What the rows are of: hit or episode.
    """
    values = table[list(columns)].to_numpy(np.float64)  # (n_rows, n_columns)
    wrong = np.argwhere(np.abs(values) > limit)
    if len(wrong):
        row, column = wrong[0]
        raise InputError(
            f"{file}: row {row} (the first is 0), {of} {table[of].iloc[row]}: {columns[column]} is "
            f"{values[row, column]:.6g}, beyond what {what} can be ({limit:g}): correct it or remove the row"
        )


def check_metres(table: pd.DataFrame, x: str, y: str, file: Path | str) -> None:
    """Refuse positions that lie too far from the origin to be in metres."""
    distance = np.hypot(table[x].to_numpy(), table[y].to_numpy())
    typical = _median(distance)
    if typical > FARTHEST_M:
        raise InputError(
            f"{file}: columns {x!r} and {y!r} lie {typical:.4g} from the origin (median), too far "
            f"for metres: {_MILLIMETRES}"
        )


def check_travel(hits: pd.DataFrame, file: Path) -> None:
    """Refuse travels from start to rest that are too long to be in metres."""
    travel = np.hypot(
        (hits["rest_x"] - hits["start_x"]).to_numpy(), (hits["rest_y"] - hits["start_y"]).to_numpy()
    )
    typical = _median(travel)
    if typical > FARTHEST_M:
        raise InputError(
            f"{file}: from start to rest objects travel {typical:.4g} (median), too far for "
            f"metres: {_MILLIMETRES}"
        )


def check_radians(table: pd.DataFrame, columns: list[str], file: Path) -> None:
    """Refuse angles that can only be in degrees (column by column: other joints may rest at 0)."""
    for column in columns:
        typical = _median(np.abs(table[column].to_numpy()))
        if typical > LARGEST_ANGLE_RAD:
            raise InputError(
                f"{file}: column {column!r} has a median size of {typical:.4g}, too large for "
                "radians: if it is in degrees, multiply by pi/180; if it counts turns, wrap it"
            )


def check_frame_interval(tracks: pd.DataFrame, camera_rate_hz: float, file: Path) -> None:
    """Refuse times that cannot be seconds at the camera's rate (median interval within 10 times).

    Missing frames only lengthen some intervals, so the median bears up to half of them.
    """
    interval = _median(tracks.groupby("hit")["t"].diff().to_numpy())
    frames = interval * camera_rate_hz
    if frames > FRAME_INTERVAL_FACTOR:
        remedy = "if t is in milliseconds, divide by 1000, else correct the rate"
    elif frames < 1 / FRAME_INTERVAL_FACTOR:
        remedy = "give t in seconds, or correct the rate"
    else:  # also NaN: no hit has two frames
        return
    raise InputError(
        f"{file}: column 't': frames are {interval:.4g} apart (median), but camera_rate_hz in "
        f"{HEADER_FILE} is {camera_rate_hz:g}: {remedy}"
    )


def check_dense_hits(tracks: pd.DataFrame, camera_rate_hz: float, file: Path) -> None:
    """Refuse single hits whose frames follow each other ten times as fast as the camera takes them."""
    interval = tracks.groupby("hit")["t"].diff().groupby(tracks["hit"]).median()
    dense = interval * camera_rate_hz < 1 / FRAME_INTERVAL_FACTOR
    if dense.any():
        hit = dense.index[dense][0]
        raise InputError(
            f"{file}: hit {hit}: frames are {interval[hit]:.4g} s apart (median), but camera_rate_hz in "
            f"{HEADER_FILE} is {camera_rate_hz:g}: give its t in seconds, or leave the hit out"
        )


def check_swing_length(table: pd.DataFrame, file: Path) -> None:
    """Refuse swings that last so long that their times can only be in milliseconds."""
    typical = _median(table.groupby("hit")["t"].max().to_numpy())
    if typical > LONGEST_SWING_S:
        raise InputError(
            f"{file}: column 't': a hit lasts {typical:.4g} (median), too long for seconds: if t "
            "is in milliseconds, divide by 1000"
        )


def check_begin(table: pd.DataFrame, file: Path, of: str = "hit") -> None:
    """Refuse times that do not count from the starts of the hits or episodes."""
    typical = _median(table.groupby(of)["t"].min().to_numpy())
    if typical > LATEST_BEGIN_S:
        raise InputError(
            f"{file}: column 't': {of}s begin at {typical:.6g} s (median), not near 0: subtract from the "
            f"times of each {of} the moment at which it starts, in all tables the same"
        )


def check_dates(table: pd.DataFrame, file: Path, of: str = "hit") -> None:
    """Refuse dates that come from a counter of another unit or origin."""
    when = table["recorded_at"]
    wrong = ((when < EARLIEST) | (when > LATEST)).to_numpy()
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{file}: row {row} (the first is 0), {of} {table[of].iloc[row]}: recorded_at is not "
            f"between {EARLIEST.year} and {LATEST.year}: correct it, or use null if it is not known"
        )


def _median(values: np.ndarray) -> float:
    """Median of what is not NaN; NaN (which no comparison finds too large) where nothing is."""
    seen = values[~np.isnan(values)]
    return float(np.median(seen)) if seen.size else float("nan")
