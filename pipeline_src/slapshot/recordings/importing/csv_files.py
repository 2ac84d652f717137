"""The hits in a folder, a glob or one long table of CSV files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.recordings.importing.files import fields_of_names, find_sources, natural_key
from slapshot.recordings.importing.mapping import TrackMapping
from slapshot.recordings.importing.rows import Rows, read_rows


@dataclass(frozen=True)
class RawHit:
    """A hit as read from its file, without frames that did not detect the object.

    Attributes:
        name: for messages: the file, and which hit of it.
        fields: texts that name it.
        lines: (n,) lines of the frames in the file.
        t: (n,) s from its first row.
        xy: (n, 2) m.
        yaw: (n,) rad, NaN where not measured.
        start: (2,) m as the file says it, or None.
        order: as the file says it, or None.
        remarks: what was left out, in words.
    """

    name: str
    fields: dict[str, str]
    lines: NDArray[np.int64]
    t: Array
    xy: Array
    yaw: Array
    start: Array | None
    order: float | None
    remarks: tuple[str, ...]


def read_hits(mapping: TrackMapping, source: Path) -> list[RawHit]:
    """All hits of a source, in the natural order of their names (hit 2 before hit 10).

    Args:
        mapping: meaning of files and columns.
        source: a folder, a file, or a path with * in it.

    Raises:
        InputError: There is no file, or one of them cannot be read as the mapping says.
    """
    root, files = find_sources(mapping.files, source)
    hits: list[RawHit] = []
    for file, fields in zip(files, fields_of_names(mapping.name_pattern, files), strict=True):
        rows = read_rows(mapping, file)
        name = file.relative_to(root).as_posix()
        parts = _parts(rows)
        for key, which in parts.items():
            label = name if len(parts) == 1 else f"{name}, hit {key}"
            hits.append(_raw_hit(mapping, rows, which, label, fields))
    return hits


def _parts(rows: Rows) -> dict[str, NDArray[np.int64]]:
    """Hits of a file in natural order -> their rows."""
    count = len(rows.lines)
    marks = rows.texts.get("<new_hit>", [""] * count)
    part = np.cumsum([i > 0 and marks[i] != marks[i - 1] for i in range(count)])
    names = rows.texts.get("<hit>", [""] * count)
    many = part.max() > 0
    found: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        key = f"{name}.{part[i] + 1}".lstrip(".") if many else name
        found.setdefault(key, []).append(i)
    return {key: np.array(found[key]) for key in sorted(found, key=natural_key)}


def _raw_hit(
    mapping: TrackMapping, rows: Rows, which: NDArray[np.int64], name: str, fields: dict[str, str]
) -> RawHit:
    numbers = {role: values[which] for role, values in rows.numbers.items()}
    lines, remarks = rows.lines[which], []
    if rows.cut_short and which[-1] == len(rows.lines) - 1:
        remarks.append("its last line is cut short and was left out")
    if rows.longest_row > 1:
        remarks.append(f"one of the file's rows goes over {rows.longest_row} lines, between quotes")
    # Without a clock every row is one frame later, whether the tracker saw the object or not.
    t = numbers.get("t", np.arange(len(which)) / mapping.camera_rate_hz)
    xy = np.stack([numbers["x"], numbers["y"]], axis=1)
    seen = ~(np.isnan(t) | np.isnan(xy).any(axis=1))
    if not seen.all():
        remarks.append(f"{(~seen).sum()} of {len(seen)} frames did not detect the object")
    twice = _duplicate_frames(t, xy, seen)
    if twice.any():
        remarks.append(f"{twice.sum()} duplicate frames were removed")
    keep = np.flatnonzero(seen & ~twice)
    _check_times(rows, t[keep], lines[keep])
    starts = [numbers[role] for role in ("start_x", "start_y") if role in numbers]
    if any(len(np.unique(place[~np.isnan(place)])) > 1 for place in starts):
        remarks.append("its start_x or start_y changes: if another hit follows, name it as new_hit, too")
    given = {
        role: _first_number(numbers[role]) for role in ("start_x", "start_y", "order") if role in numbers
    }
    start = np.array([given["start_x"], given["start_y"]]) if "start_x" in given else None
    texts = {field: rows.texts[field][which[0]] for field in mapping.texts if not field.startswith("<")}
    if start is not None and np.isnan(start).any():
        raise InputError(
            f"{rows.file}: line {lines[0]}: {name}: start_x or start_y is empty; fill it in, or leave both "
            "out of the mapping: it is estimated from the frames before the hit"
        )
    return RawHit(
        name=name,
        fields=fields | texts,
        lines=lines[keep],
        t=t[keep] - (t[keep][0] if len(keep) else 0.0),
        xy=xy[keep],
        yaw=numbers.get("yaw", np.full(len(which), np.nan))[keep],
        start=start,
        order=given.get("order"),
        remarks=tuple(remarks),
    )


def _duplicate_frames(t: Array, xy: Array, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) whether a frame repeats time and position of the previous frame with a detection."""
    rows = np.flatnonzero(seen)
    same = (np.diff(t[rows]) == 0) & (np.diff(xy[rows], axis=0) == 0).all(axis=1)
    twice = np.zeros(len(t), dtype=bool)
    twice[rows[1:][same]] = True
    return twice


def _check_times(rows: Rows, t: Array, lines: NDArray[np.int64]) -> None:
    wrong = np.flatnonzero(np.diff(t) <= 0)
    if wrong.size:
        before, after = wrong[0], wrong[0] + 1
        problem = "the same time at two places" if t[after] == t[before] else "time goes backwards"
        raise InputError(
            f"{rows.file}: line {lines[after]}: {problem} ({t[before]:.10g} s in line {lines[before]}, then "
            f"{t[after]:.10g} s); correct the lines, name a hit or new_hit column if other hits follow, or "
            "leave t out of the mapping to count frames"
        )


def _first_number(values: Array) -> float:
    given = values[~np.isnan(values)]
    return float(given[0]) if given.size else float("nan")
