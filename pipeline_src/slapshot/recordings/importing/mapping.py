"""A mapping: the meaning of files and columns, read from a YAML file and checked."""

import re
from collections import Counter
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    StringConstraints,
    field_validator,
    model_validator,
)

from slapshot.errors import InputError
from slapshot.recordings.header import FreeText, RigDescription
from slapshot.recordings.importing.name_pattern import NamePattern
from slapshot.validation import Model, short, validated
from slapshot.yaml_file import Document, read_document

MAX_TEXT = 200  # characters of a pattern, a template, or a text in a file
# Fields that every hit has; the others come from the file's name and from columns.
FILE_FIELDS = ("file", "folder")
_FIELD = re.compile(r"\{(\w+)\}")
_HUGE, _TINY = 1e6, 1e-9  # bounds far beyond any rig
_DELIMITERS = {"tab": "\t", "blanks": None}
_IN_NUMBERS = "0123456789+-.eE"
# Uninitialised memory reads as numbers like 1e-310 or 1e160. No tracker reports these.
_TINIEST, _LARGEST = 1e-30, 1e6

T = TypeVar("T")


def _has_value(value: Any) -> Any:
    if value is None:
        raise ValueError("has no value; write one, or remove the key")
    return value


# A key that may be left out, but not left empty.
Given = Annotated[T | None, BeforeValidator(_has_value)]


def _pattern(text: str) -> str:
    parts = PurePosixPath(text).parts
    if not parts or parts[0] == "/" or ".." in parts:
        raise ValueError(
            f"{short(text)} is no pattern of files in the folder that is given; write one such as *.csv"
        )
    return text


def _template(text: str) -> str:
    if {"{", "}"} & set(_FIELD.sub("", text)):
        raise ValueError(f"{short(text)} has a brace that belongs to no {{field}}; write {{name}}")
    return text


def _delimiter(text: str) -> str:
    if text not in _DELIMITERS and (len(text) != 1 or text in _IN_NUMBERS + '"\n\r'):
        raise ValueError(
            f"{short(text)} is no single character that can part numbers; write one, or tab, or blanks"
        )
    return text


Text = Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]
Template = Annotated[Text, AfterValidator(_template)]
Number = Annotated[float, Field(ge=-_HUGE, le=_HUGE)]
ColumnRef = (
    Annotated[int, Field(ge=0, le=int(_HUGE))]
    | Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=MAX_TEXT)]
)
_PLACE = "name in the header, or number of the column from 0"
_TEMPLATE = "a {name} in it stands for a field, {file} and {folder} for the names of the file and its folder"


class ScaledColumn(Model):
    """A column of numbers: value in the recording = factor * number + offset."""

    column: ColumnRef = Field(description=_PLACE)
    factor: Number = Field(
        default=1.0, description="what to multiply by: 0.001 turns mm into m, -1 turns an axis round"
    )
    offset: Number = Field(default=0.0, description="what to add after that, in the unit of the recording")

    @model_validator(mode="before")
    @classmethod
    def _alone(cls, value: Any) -> Any:
        return {"column": value} if isinstance(value, str | int) else value

    @field_validator("factor")
    @classmethod
    def _keeps_values_apart(cls, factor: float) -> float:
        if abs(factor) < _TINY:
            raise ValueError(f"{factor:g} would make all values equal; write another")
        return factor


class Columns(Model):
    """Which column holds what."""

    x: ScaledColumn = Field(description="place of the object, in m")
    y: ScaledColumn = Field(description="place of the object, in m")
    yaw: Given[ScaledColumn] = Field(default=None, description="turn of the object about z, in rad")
    t: Given[ScaledColumn] = Field(
        default=None, description="time of the frame, in s; without it frames are counted at camera_rate_hz"
    )
    start_x: Given[ScaledColumn] = Field(
        default=None, description="place before the hit, in m; else estimated from the frames"
    )
    start_y: Given[ScaledColumn] = Field(
        default=None, description="place before the hit, in m; else estimated from the frames"
    )
    order: Given[ScaledColumn] = Field(
        default=None,
        description="place of the hit in the order of execution; without it the order of file names",
    )
    hit: Given[ColumnRef] = Field(
        default=None, description=f"which hit of the file a row belongs to: {_PLACE}"
    )
    new_hit: Given[ColumnRef] = Field(
        default=None, description=f"a column whose change begins a new hit in a file: {_PLACE}"
    )


class Files(Model):
    """Which files are hits."""

    pattern: Annotated[Text, AfterValidator(_pattern)] = Field(
        default="*.csv",
        description="names of the files in the folder, **/ before it for folders in it: *.csv",
    )
    name_pattern: Given[Text] = Field(
        default=None,
        description="regular expression for the file's name without its ending; its named groups, "
        "(?P<name>...), become fields",
    )


class CsvStyle(Model):
    """What the files look like."""

    delimiter: Annotated[str, AfterValidator(_delimiter)] = Field(
        default=",", description="one character, or the word tab or blanks (any number of them)"
    )
    decimal: Literal[".", ","] = Field(default=".", description="character between whole and fraction")
    header: bool = Field(default=True, description="true where the first row names the columns")
    skip_rows: int = Field(
        default=0, ge=0, le=int(_HUGE), description="lines before the header or the first row"
    )
    missing: Annotated[
        tuple[Annotated[str, Field(max_length=MAX_TEXT, description="a text, in quotes")], ...],
        Field(strict=False, max_length=100),
    ] = Field(default=(), description="texts that mean 'not seen', in quotes, besides an empty one and NaN")

    @property
    def separator(self) -> str | None:
        """What stands between columns; None for any number of blanks."""
        return _DELIMITERS.get(self.delimiter, self.delimiter)


class RecordedAt(Model):
    """When a hit was executed."""

    text: Template = Field(description=f"date and time; {_TEMPLATE}")
    format: Text = Field(description="of that text, as strptime has it, for example %Y-%m-%d_%H:%M:%S")
    utc_offset_h: float = Field(
        default=0.0, ge=-24, le=24, description="hours by which that clock is ahead of UTC"
    )


class Crop(Model):
    """What to keep around the slide."""

    before_motion_s: float = Field(ge=0, le=_HUGE, description="s before motion begins")
    after_rest_s: float = Field(ge=0, le=_HUGE, description="s after the object came to rest")


class TrackMapping(RigDescription):
    """How CSV files become a recording."""

    note: FreeText = ""
    object_id: Given[Template] = Field(
        default=None, description=f"which object was hit; not needed with one object; {_TEMPLATE}"
    )
    command: Given[Template] = Field(
        default=None, description=f"text that is equal for repeats of one command; {_TEMPLATE}"
    )
    files: Files = Files()
    csv: CsvStyle = CsvStyle()
    columns: Columns
    fields: dict[Annotated[str, Field(pattern=r"^\w{1,64}$")], ColumnRef] = Field(
        default={}, max_length=100, description="field -> column whose text in the hit's first row it takes"
    )
    recorded_at: Given[RecordedAt] = Field(default=None, description="when a hit was executed")
    crop: Given[Crop] = Field(default=None, description="what to keep around the slide; else all frames stay")
    longest_s: float = Field(default=60.0, gt=0, le=_HUGE, description="a longer hit is dropped (s)")
    moving_at_start: Literal["keep", "drop"] = Field(
        default="drop", description="keep or drop hits whose first frame moves"
    )
    moving_at_end: Literal["keep", "drop"] = Field(
        default="keep", description="keep or drop hits whose last frame moves"
    )
    _document: Document = PrivateAttr()
    _name_pattern: NamePattern | None = PrivateAttr(None)

    @property
    def file(self) -> Path:
        """The mapping's own."""
        return self._document.path

    @property
    def sizes(self) -> tuple[float, float]:
        """Least and largest size of what a tracker reports."""
        return _TINIEST, _LARGEST

    def location_of(self, role: str) -> str:
        """File, line and key of the mapping where a role's column is named."""
        return self.where("columns", role)

    def where(self, *loc: str) -> str:
        """File, line and key of what it says, for errors."""
        return f"{self._document.where(loc)}: {'.'.join(loc)}"

    @property
    def numbers(self) -> dict[str, ScaledColumn]:
        """Role (x, y, yaw, t, start_x, start_y, order) -> column."""
        return {role: column for role, column in self.columns if isinstance(column, ScaledColumn)}

    @property
    def texts(self) -> dict[str, str | int]:
        """Field, or one of the roles "hit" and "new_hit" in brackets -> column."""
        roles = {"<hit>": self.columns.hit, "<new_hit>": self.columns.new_hit}
        return self.fields | {role: place for role, place in roles.items() if place is not None}

    @property
    def name_pattern(self) -> NamePattern | None:
        """What makes fields of a file's name."""
        return self._name_pattern


def load_mapping(file: Path) -> TrackMapping:
    """Read and check a mapping.

    Raises:
        InputError: It is missing, not YAML, or says something that cannot be.
    """
    document = read_document(file)
    mapping = validated(TrackMapping, document.values, document.where)
    mapping._document = document
    if mapping.files.name_pattern is not None:
        mapping._name_pattern = NamePattern(
            mapping.files.name_pattern, mapping.where("files", "name_pattern")
        )
    _check_columns(mapping)
    _check_fields(mapping)
    return mapping


def fill(template: str, fields: dict[str, str]) -> str:
    """The template with the fields' texts in it."""
    return _FIELD.sub(lambda match: fields[match[1]], template)


def _check_columns(mapping: TrackMapping) -> None:
    """Checks of columns that involve several keys."""
    style, numbers = mapping.csv, mapping.numbers
    if style.separator == style.decimal:
        raise InputError(
            f"{mapping.where('csv', 'decimal')}: is the delimiter {style.decimal!r}, too; correct one of them"
        )
    if ("start_x" in numbers) != ("start_y" in numbers):
        raise InputError(f"{mapping.where('columns')}: give both start_x and start_y, or neither")
    if not style.header:
        places = {("columns", role): column.column for role, column in numbers.items()}
        places |= {("columns", role): getattr(mapping.columns, role) for role in ("hit", "new_hit")}
        for loc, place in (
            places | {("fields", name): place for name, place in mapping.fields.items()}
        ).items():
            if isinstance(place, str):
                raise InputError(
                    f"{mapping.where(*loc)}: {place!r} is a name, but csv.header is false; write the number "
                    "of the column (the first is 0), or header: true"
                )


def _check_fields(mapping: TrackMapping) -> None:
    """Refuse fields that are given twice or not at all."""
    if mapping.object_id is None and len(mapping.objects) > 1:
        raise InputError(
            f"{mapping.where('objects')}: key 'object_id' is missing; say which of the "
            f"{len(mapping.objects)} it was"
        )
    groups = mapping.name_pattern.groups if mapping.name_pattern else ()
    known = [*FILE_FIELDS, *groups, *mapping.fields]
    for name, count in Counter(known).items():
        if count > 1:
            loc = ("fields", name) if name in mapping.fields else ("files", "name_pattern")
            raise InputError(
                f"{mapping.where(*loc)}: field {name!r} is given twice; give one of them another name"
            )
    templates: dict[tuple[str, ...], str | None] = {
        ("object_id",): mapping.object_id,
        ("command",): mapping.command,
    }
    if mapping.recorded_at:
        templates["recorded_at", "text"] = mapping.recorded_at.text
    for key, template in templates.items():
        for name in _FIELD.findall(template or ""):
            if name not in known:
                raise InputError(
                    f"{mapping.where(*key)}: there is no field {name!r}; name it under fields or in "
                    f"files.name_pattern (known: {', '.join(known)})"
                )
