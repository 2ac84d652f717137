"""From CSV files to a recording: `import_tracks`."""

import json
import re
import uuid
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.errors import InputError, writing
from slapshot.json_types import JsonObject
from slapshot.recordings.format import Recording
from slapshot.recordings.importing.csv_files import RawHit, read_hits
from slapshot.recordings.importing.files import natural_key
from slapshot.recordings.importing.mapping import TrackMapping, fill, load_mapping
from slapshot.recordings.importing.segmentation import HitSegment, segment_hit
from slapshot.recordings.plausibility import FRAME_INTERVAL_FACTOR, check_metres
from slapshot.recordings.write import check_new, write_recording
from slapshot.validation import short

# Source file and lines of each hit, and what was changed; not part of the format.
SOURCES_FILE = "import.json"


@dataclass(frozen=True)
class ImportSummary:
    """What an import did.

    Attributes:
        out: folder of the recording.
        hits: how many it has.
        frames: how many it has.
        dropped: names of hits that were left out.
        lines: notes for the user, one line for each hit or fact.
    """

    out: Path
    hits: int
    frames: int
    dropped: tuple[str, ...]
    lines: tuple[str, ...]


def import_tracks(mapping: Path, source: Path, out: Path) -> ImportSummary:
    """Make a recording of the hits in CSV files.

    Args:
        mapping: YAML file, see `TrackMapping`.
        source: a folder of CSV files, one of them, or a path with * in it.
        out: folder of the recording; must not exist yet.

    Returns:
        A summary of what was kept, cropped and dropped.

    Raises:
        InputError: The mapping or a file cannot be used, no hit is left, or `out` exists.
    """
    check_new(out)  # before hours of reading, not after
    rules = load_mapping(mapping)
    raw = _in_order(read_hits(rules, source), rules)
    _check_rate(raw, rules)
    _check_places(raw, rules)
    segments = [segment_hit(hit.t, hit.xy, rules) for hit in raw]
    kept = [(hit, segment) for hit, segment in zip(raw, segments, strict=True) if segment.dropped is None]
    if not kept:
        raise InputError(
            f"{source}: no hit is left: {raw[0].name} {segments[0].dropped}; check the columns and factors "
            f"in {mapping}"
        )
    recording = _recording(rules, kept)
    write_recording(recording, out)
    lines = _facts(rules)
    for hit, segment in zip(raw, segments, strict=True):
        said = [f"dropped, for it {segment.dropped}"] if segment.dropped else [*hit.remarks, *segment.remarks]
        lines += [f"{hit.name}: {'; '.join(said)}"] if said else []
    dropped = tuple(hit.name for hit, segment in zip(raw, segments, strict=True) if segment.dropped)
    write_sources(out, {"lines": lines, "hits": _sources(kept)})
    frames = 0 if recording.tracks is None else len(recording.tracks)
    return ImportSummary(out, len(kept), frames, dropped, tuple(lines))


def _in_order(hits: list[RawHit], rules: TrackMapping) -> list[RawHit]:
    """Hits in the order of execution, as far as it is known."""
    if "order" in rules.numbers:
        for hit in hits:
            if hit.order is None or np.isnan(hit.order):
                raise InputError(
                    f"{hit.name}: its order is empty; fill it in, or leave order out of the mapping"
                )
        return sorted(hits, key=lambda hit: (hit.order, natural_key(hit.name)))
    if rules.recorded_at is not None:
        return sorted(hits, key=lambda hit: (_recorded_at(hit, rules), natural_key(hit.name)))
    return hits


def _check_rate(hits: list[RawHit], rules: TrackMapping) -> None:
    """Refuse times in another unit before motion detection depends on them."""
    intervals = np.concatenate([np.diff(hit.t) for hit in hits])
    frames = float(np.median(intervals)) * rules.camera_rate_hz if len(intervals) else 1.0
    if not 1 / FRAME_INTERVAL_FACTOR <= frames <= FRAME_INTERVAL_FACTOR:
        raise InputError(
            f"{rules.where('columns', 't')}: frames are {np.median(intervals):.4g} s apart (median), but "
            f"camera_rate_hz is {rules.camera_rate_hz:g}; correct the factor of t (0.001 if it is in ms), or "
            "the rate"
        )


def _check_places(hits: list[RawHit], rules: TrackMapping) -> None:
    """Refuse positions in another unit before motion detection depends on them."""
    places = np.concatenate([hit.xy for hit in hits])
    check_metres(pd.DataFrame(places, columns=["x", "y"]), "x", "y", rules.where("columns"))


def _facts(rules: TrackMapping) -> list[str]:
    facts = []
    if "t" not in rules.numbers:
        facts.append(f"no clock: times are frames counted at {rules.camera_rate_hz:g} a second")
    if "order" not in rules.numbers and rules.recorded_at is None:
        facts.append(
            "no order: hits are numbered in the order of their names, which may not be that of execution"
        )
    return facts


def _recording(rules: TrackMapping, kept: list[tuple[RawHit, HitSegment]]) -> Recording:
    hits, tracks = [], []
    commands: dict[str, int] = {}
    for number, (hit, segment) in enumerate(kept):
        start = segment.start if hit.start is None else hit.start
        hits.append(
            {
                "hit": number,
                "object_id": _object_id(hit, rules),
                "order": number,
                "recorded_at": _recorded_at(hit, rules) if rules.recorded_at else pd.NaT,
                "command_id": _command_id(hit, rules, commands),
                "start_x": start[0],
                "start_y": start[1],
                "rest_x": segment.rest[0],
                "rest_y": segment.rest[1],
            }
        )
        stay = slice(segment.first, segment.last + 1)
        x, y = hit.xy[stay].T
        t = hit.t[stay] - hit.t[segment.first]
        tracks.append(pd.DataFrame({"hit": number, "t": t, "x": x, "y": y, "yaw": hit.yaw[stay]}))
    table = pd.DataFrame(hits)
    table["command_id"] = pd.array(table["command_id"].tolist(), dtype="Int64")
    table["recorded_at"] = pd.to_datetime(table["recorded_at"], utc=True)
    return Recording(
        rig=rules.rig,
        objects=rules.objects,
        camera_rate_hz=rules.camera_rate_hz,
        frame_note=rules.frame_note,
        stand_in=False,
        trajectory_model=None,
        note=" ".join([rules.note, *(f"Imported with {fact}." for fact in _facts(rules))]).strip(),
        sealed_truth_sha256=None,
        hits=table,
        tracks=pd.concat(tracks, ignore_index=True),
        commands=None,
        joints=None,
    )


def _object_id(hit: RawHit, rules: TrackMapping) -> str:
    object_id = fill(rules.object_id, hit.fields) if rules.object_id else next(iter(rules.objects))
    if object_id not in rules.objects:
        raise InputError(
            f"{hit.name}: object_id {short(object_id)} is not among the objects of {rules.file} "
            f"({short(list(rules.objects))}); describe it there, or correct object_id"
        )
    return object_id


def _command_id(hit: RawHit, rules: TrackMapping, known: dict[str, int]) -> int | None:
    """Equal numbers for equal texts; `known` grows."""
    return None if rules.command is None else known.setdefault(fill(rules.command, hit.fields), len(known))


def _recorded_at(hit: RawHit, rules: TrackMapping) -> datetime:
    spec = rules.recorded_at
    assert spec is not None
    text = fill(spec.text, hit.fields)
    try:
        local = datetime.strptime(text, spec.format)
        # A time zone in the text (%z) takes precedence over the mapping's.
        zoned = local if local.tzinfo else local.replace(tzinfo=UTC) - timedelta(hours=spec.utc_offset_h)
        return zoned.astimezone(UTC)
    except (ValueError, OverflowError, re.error) as error:  # the last for a directive that stands twice
        raise InputError(
            f"{hit.name}: recorded_at: {short(text)} is no time of the format {short(spec.format)} "
            f"({str(error)[:200]}); correct {rules.where('recorded_at')}"
        ) from None


def _sources(kept: list[tuple[RawHit, HitSegment]]) -> list[JsonObject]:
    """The lines of the files that each hit is from."""
    return [
        {
            "hit": number,
            "source": hit.name,
            "first_line": int(hit.lines[segment.first]),
            "last_line": int(hit.lines[segment.last]),
            "fields": hit.fields,
        }
        for number, (hit, segment) in enumerate(kept)
    ]


def write_sources(out: Path, content: JsonObject) -> None:
    """Write the sources of a recording beside it.

    Args:
        out: folder of the recording.
        content: of the file.
    """
    partial = out / f".{SOURCES_FILE}.{uuid.uuid4().hex[:8]}.partial"
    try:
        with writing(out / SOURCES_FILE):
            partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
            partial.rename(out / SOURCES_FILE)
    finally:
        partial.unlink(missing_ok=True)
