"""A mapping: which files and columns are what, read from a YAML file and checked."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slapshot.errors import InputError
from slapshot.recordings.format import ObjectInfo
from slapshot.recordings.header import objects_of
from slapshot.recordings.importing.schema import check_mapping
from slapshot.yaml_file import read_yaml

# Fields that every hit has; the others come from the file's name and from columns.
FILE_FIELDS = ("file", "folder")
_FIELD = re.compile(r"\{(\w+)\}")
_DELIMITERS = {"tab": "\t", "blanks": None}


@dataclass(frozen=True)
class Column:
    """A column of numbers.

    Attributes:
        place: name in the header, or number from 0.
        factor, offset: value in the recording = factor * number + offset.
    """

    place: str | int
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class CsvStyle:
    """What the files look like.

    Attributes:
        delimiter: between columns; None for any number of blanks.
        decimal: between whole and fraction.
        header: whether a row names the columns.
        skip_rows: lines before it.
        missing: texts that mean that nothing was seen.
    """

    delimiter: str | None
    decimal: str
    header: bool
    skip_rows: int
    missing: frozenset[str]


@dataclass(frozen=True)
class Cutting:
    """Which frames of a hit stay, and which hits.

    Attributes:
        before_motion_s, after_rest_s: s to keep around the slide; None to keep all frames.
        longest_s: s; a longer hit is dropped.
        keep_moving_at_start, keep_moving_at_end: whether hits stay that were not seen whole.
    """

    before_motion_s: float | None
    after_rest_s: float | None
    longest_s: float
    keep_moving_at_start: bool
    keep_moving_at_end: bool


@dataclass(frozen=True)
class RecordedAt:
    """When a hit was executed: a template, its format for strptime, and hours ahead of UTC."""

    text: str
    format: str
    utc_offset_h: float


@dataclass(frozen=True)
class TrackMapping:
    """How CSV files become a recording.

    Attributes:
        file: the mapping's own, for errors.
        rig, frame_note, note, objects, camera_rate_hz: as in a recording.
        object_id: template.
        command: template that is equal for repeats of one command, or None.
        pattern: of file names in a folder.
        name_pattern: with a named group for each field, or None.
        csv: what the files look like.
        numbers: role (x, y, yaw, t, start_x, start_y, order) -> column.
        texts: field, or one of the roles "hit" and "new_hit" in brackets -> column.
        recorded_at: or None.
        cutting: which frames and hits stay.
    """

    file: Path
    rig: str
    frame_note: str
    note: str
    objects: dict[str, ObjectInfo]
    camera_rate_hz: float
    object_id: str
    command: str | None
    pattern: str
    name_pattern: re.Pattern[str] | None
    csv: CsvStyle
    numbers: dict[str, Column]
    texts: dict[str, str | int]
    recorded_at: RecordedAt | None
    cutting: Cutting


def load_mapping(file: Path) -> TrackMapping:
    """Read and check a mapping.

    Raises:
        InputError: It is missing, not YAML, or says something that cannot be.
    """
    raw = read_yaml(file)
    check_mapping(raw, file)
    files, crop = raw.get("files", {}), raw.get("crop", {})
    columns = dict(raw["columns"])
    roles = {f"<{role}>": _place(columns.pop(role)) for role in ("hit", "new_hit") if role in columns}
    recorded_at = raw.get("recorded_at")
    mapping = TrackMapping(
        file=file,
        rig=raw["rig"],
        frame_note=raw["frame_note"],
        note=raw.get("note", ""),
        objects=objects_of(raw),
        camera_rate_hz=float(raw["camera_rate_hz"]),
        object_id=raw.get("object_id", next(iter(raw["objects"]))),
        command=raw.get("command"),
        pattern=files.get("pattern", "*.csv"),
        name_pattern=_compile(files.get("name_pattern"), file),
        csv=_csv_style(raw.get("csv", {}), file),
        numbers={role: _column(value) for role, value in columns.items()},
        texts={name: _place(value) for name, value in raw.get("fields", {}).items()} | roles,
        recorded_at=recorded_at
        and RecordedAt(recorded_at["text"], recorded_at["format"], recorded_at.get("utc_offset_h", 0.0)),
        cutting=Cutting(
            before_motion_s=crop.get("before_motion_s"),
            after_rest_s=crop.get("after_rest_s"),
            longest_s=float(raw.get("longest_s", 60.0)),
            keep_moving_at_start=raw.get("moving_at_start", "drop") == "keep",
            keep_moving_at_end=raw.get("moving_at_end", "keep") == "keep",
        ),
    )
    if "object_id" not in raw and len(mapping.objects) > 1:
        raise InputError(
            f"{file}: key 'object_id' is missing; say which of the {len(mapping.objects)} it was"
        )
    _check_consistent(mapping)
    return mapping


def fill(template: str, fields: dict[str, str]) -> str:
    """The template with the fields' texts in it."""
    return _FIELD.sub(lambda match: fields[match[1]], template)


def _check_consistent(mapping: TrackMapping) -> None:
    """Refuse what a schema cannot judge."""
    file, style = mapping.file, mapping.csv
    if ("start_x" in mapping.numbers) != ("start_y" in mapping.numbers):
        raise InputError(f"{file}: columns: give both start_x and start_y, or neither")
    for role, column in mapping.numbers.items():
        if column.factor == 0:
            raise InputError(f"{file}: columns.{role}.factor: 0 would make all values equal; write another")
    if not style.header:
        places = {role: column.place for role, column in mapping.numbers.items()} | mapping.texts
        for role, place in places.items():
            if isinstance(place, str):
                raise InputError(
                    f"{file}: columns.{role}: {place!r} is a name, but csv.header is false; "
                    "write the number of the column (the first is 0), or header: true"
                )
    groups = mapping.name_pattern.groupindex if mapping.name_pattern else {}
    own = [name for name in mapping.texts if not name.startswith("<")]
    known = [*FILE_FIELDS, *groups, *own]
    for name in known:
        if known.count(name) > 1:
            raise InputError(f"{file}: field {name!r} is given twice; give one of them another name")
    templates = {"object_id": mapping.object_id, "command": mapping.command}
    if mapping.recorded_at:
        templates["recorded_at.text"] = mapping.recorded_at.text
    for key, template in templates.items():
        for name in _FIELD.findall(template or ""):
            if name not in known:
                raise InputError(
                    f"{file}: {key}: there is no field {name!r}; name it under fields or in "
                    f"files.name_pattern (known: {', '.join(known)})"
                )


def _csv_style(raw: dict[str, Any], file: Path) -> CsvStyle:
    delimiter = raw.get("delimiter", ",")
    if delimiter not in _DELIMITERS and (len(delimiter) != 1 or delimiter in '"\n\r'):
        raise InputError(
            f"{file}: csv.delimiter: {delimiter!r} is no single character; write one, or tab, or blanks"
        )
    if delimiter == raw.get("decimal", "."):
        raise InputError(f"{file}: csv.decimal: is the delimiter {delimiter!r}, too; correct one of them")
    return CsvStyle(
        delimiter=_DELIMITERS.get(delimiter, delimiter),
        decimal=raw.get("decimal", "."),
        header=raw.get("header", True),
        skip_rows=int(raw.get("skip_rows", 0)),
        missing=frozenset(text.strip() for text in raw.get("missing", [])),
    )


def _compile(pattern: str | None, file: Path) -> re.Pattern[str] | None:
    try:
        return None if pattern is None else re.compile(pattern)
    except re.error as error:
        raise InputError(
            f"{file}: files.name_pattern: no regular expression ({error}); mend it, in single quotes"
        ) from None


def _column(value: Any) -> Column:
    if not isinstance(value, dict):
        return Column(_place(value))
    return Column(_place(value["column"]), float(value.get("factor", 1.0)), float(value.get("offset", 0.0)))


def _place(value: str | float) -> str | int:
    """JSON's integers include 4.0."""
    return value.strip() if isinstance(value, str) else int(value)
