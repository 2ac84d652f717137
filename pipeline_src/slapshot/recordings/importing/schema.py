"""What a mapping may say: its schema, and one line for what is wrong with it."""

import difflib
import math
import reprlib
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator, ValidationError

from slapshot.errors import InputError
from slapshot.recordings.format import RECORDING_SCHEMA

_HUGE = 1e6  # a bound far beyond any rig


def _mapping(description: str, properties: dict[str, Any], required: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "type": "object",
        "additionalProperties": False,
        "required": list(required),
        "properties": properties,
        "description": description,
    }


def _text(description: str, **more: Any) -> dict[str, Any]:
    return {"type": "string", "minLength": 1, "description": description, **more}


def _number(description: str, **more: Any) -> dict[str, Any]:
    return {"type": "number", "minimum": -_HUGE, "maximum": _HUGE, "description": description, **more}


_PLACE = {
    "type": ["string", "integer"],
    "minimum": 0,
    "minLength": 1,
    "description": "name in the header, or number of the column from 0",
}


def _column(what: str) -> dict[str, Any]:
    """A column that is read as a number; `column` alone may stand for the mapping."""
    full = _mapping(
        what,
        {
            "column": _PLACE,
            "factor": _number("what to multiply by: 0.001 turns mm into m, -1 turns an axis round"),
            "offset": _number("what to add after that, in the unit of the recording"),
        },
        ("column",),
    )
    return {**full, "type": ["string", "integer", "object"], "minimum": 0, "minLength": 1}


_TEMPLATE = "a {name} in it stands for a field, {file} and {folder} for the names of the file and its folder"

MAPPING_SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    **_mapping(
        "how CSV files become a recording",
        {
            "rig": RECORDING_SCHEMA["properties"]["rig"],
            "frame_note": RECORDING_SCHEMA["properties"]["frame_note"],
            "note": RECORDING_SCHEMA["properties"]["note"],
            "objects": RECORDING_SCHEMA["properties"]["objects"],
            "camera_rate_hz": RECORDING_SCHEMA["properties"]["camera_rate_hz"],
            "object_id": _text(f"which object was hit; not needed with one object; {_TEMPLATE}"),
            "command": _text(f"text that is equal for repeats of one command; {_TEMPLATE}"),
            "files": _mapping(
                "which files are hits",
                {
                    "pattern": _text(
                        "names of the files in the folder, **/ before it for folders in it: *.csv"
                    ),
                    "name_pattern": _text(
                        "regular expression for the file's name without its ending; its named groups, "
                        "(?P<name>...), become fields"
                    ),
                },
            ),
            "csv": _mapping(
                "what the files look like",
                {
                    "delimiter": _text("one character, or the word tab or blanks (any number of them)"),
                    "decimal": _text("character between whole and fraction: . or ,", pattern=r"^[.,]$"),
                    "header": {
                        "type": "boolean",
                        "description": "true where the first row names the columns",
                    },
                    "skip_rows": {
                        "type": "integer",
                        "minimum": 0,
                        "maximum": _HUGE,
                        "description": "lines before the header or the first row",
                    },
                    "missing": {
                        "type": "array",
                        "items": {"type": "string", "description": "a text, in quotes"},
                        "description": "texts that mean 'not seen', in quotes, besides an empty one and NaN",
                    },
                },
            ),
            "columns": _mapping(
                "which column holds what",
                {
                    "x": _column("place of the object, in m"),
                    "y": _column("place of the object, in m"),
                    "yaw": _column("turn of the object about z, in rad"),
                    "t": _column("time of the frame, in s; without it frames are counted at camera_rate_hz"),
                    "start_x": _column("place before the hit, in m; without it the frames tell"),
                    "start_y": _column("place before the hit, in m; without it the frames tell"),
                    "order": _column(
                        "place of the hit in the order of execution; without it file names tell"
                    ),
                    "hit": {**_PLACE, "description": "which hit of the file a row belongs to"},
                    "new_hit": {**_PLACE, "description": "a column whose change begins a new hit in a file"},
                },
                ("x", "y"),
            ),
            "fields": {
                "type": "object",
                "additionalProperties": _PLACE,
                "description": "field -> column whose text in the hit's first row it takes",
            },
            "recorded_at": _mapping(
                "when a hit was executed",
                {
                    "text": _text(f"date and time; {_TEMPLATE}"),
                    "format": _text("of that text, as strptime has it, for example %Y-%m-%d_%H:%M:%S"),
                    "utc_offset_h": _number(
                        "hours by which that clock is ahead of UTC", minimum=-24, maximum=24
                    ),
                },
                ("text", "format"),
            ),
            "crop": _mapping(
                "what to keep around the slide; without it all frames stay",
                {
                    "before_motion_s": _number("s before motion begins", minimum=0),
                    "after_rest_s": _number("s after the object came to rest", minimum=0),
                },
                ("before_motion_s", "after_rest_s"),
            ),
            "longest_s": _number("a longer hit is dropped (s); 60 unless told", exclusiveMinimum=0),
            "moving_at_start": _text(
                "keep or drop hits whose first frame moves (drop unless told)", enum=["keep", "drop"]
            ),
            "moving_at_end": _text(
                "keep or drop hits whose last frame moves (keep unless told)", enum=["keep", "drop"]
            ),
        },
        ("rig", "frame_note", "objects", "camera_rate_hz", "columns"),
    ),
}

_TYPES = {
    "object": "a mapping",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
}
_BOUNDS = {
    "minimum": "at least {}",
    "exclusiveMinimum": "greater than {}",
    "maximum": "at most {:g}",
    "minLength": "a text of at least {} character",
    "minItems": "a list of at least {} entry",
    "minProperties": "a mapping with at least {} entry",
    "pattern": "a text that matches {}",
}


def check_mapping(value: dict[str, Any], file: Path) -> None:
    """Hold what a mapping file says against the schema.

    Raises:
        InputError: On the first key that is unknown, missing, of the wrong type or out of range.
    """
    _check_plain(value, file, ())
    errors = Draft202012Validator(MAPPING_SCHEMA).iter_errors(value)
    first = min(errors, key=lambda error: [str(part) for part in error.absolute_path], default=None)
    if first is not None:
        raise InputError(f"{file}: {_explain(first)}")


def _check_plain(value: Any, file: Path, path: tuple[str, ...]) -> None:
    """Refuse what YAML can say and the schema cannot judge: keys that are no text, infinite numbers."""
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                where = ".".join(path) or "top level"
                raise InputError(f"{file}: {where}: key {reprlib.repr(key)} is no text; write it in quotes")
            _check_plain(item, file, (*path, key))
    elif isinstance(value, list):
        for item in value:
            _check_plain(item, file, path)
    elif isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):
        raise InputError(f"{file}: {'.'.join(path)}: holds half a letter, which no file can hold; remove it")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{file}: {'.'.join(path)}: {value} is not a finite number; write one")


def _explain(error: ValidationError) -> str:
    """Key, what is wrong with it, and what would be right, in one line."""
    key = ".".join(str(part) for part in error.absolute_path) or "top level"
    # Typed as Any, for the stubs allow each of them to be unset until the error is complete.
    instance: Any = error.instance
    schema: Any = error.schema
    limit: Any = error.validator_value
    if error.validator == "additionalProperties":
        known = sorted(schema["properties"])
        unknown = min(set(instance) - set(known))
        close = difflib.get_close_matches(unknown, known, n=1)
        mend = f"write {close[0]!r}" if close else "remove it"
        return f"{key}: unknown key {reprlib.repr(unknown)}; {mend} (known: {', '.join(known)})"
    if error.validator == "required":
        missing = next(name for name in limit if name not in instance)
        meaning = schema["properties"][missing]["description"]
        return f"{key}: key {missing!r} is missing; add it ({meaning})"
    if error.validator == "type":
        names = [limit] if isinstance(limit, str) else limit
        wanted = " or ".join(_TYPES[name] for name in names)
    elif error.validator == "enum":
        wanted = " or ".join(limit)
    else:
        wanted = _BOUNDS[str(error.validator)].format(limit)
    meaning = f" ({schema['description']})" if "description" in schema else ""
    return f"{key}: must be {wanted}, not {reprlib.repr(instance)}; correct it{meaning}"
