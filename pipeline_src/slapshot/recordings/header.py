"""recording.json: to and from its dictionary, with messages for a person."""

import json
import reprlib
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator, ValidationError

from slapshot.errors import InputError
from slapshot.recordings.format import (
    FORMAT_VERSION,
    RECORDING_SCHEMA,
    ObjectInfo,
    Recording,
)

_TYPE_WORDS = {
    "object": "an object in braces",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}

_LIMIT_WORDS = {
    "minimum": "at least {}",
    "exclusiveMinimum": "greater than {}",
    "maximum": "at most {:g}",
    "minLength": "a text of at least {} character",
    "minItems": "a list of at least {} entry",
    "minProperties": "an object with at least {} entry",
    "pattern": "a text that matches {}",
}


def read_header(file: Path) -> dict[str, Any]:
    """Read and check recording.json.

    Args:
        file: Path of recording.json.

    Returns:
        The keys and values, checked against RECORDING_SCHEMA.

    Raises:
        InputError: If the file cannot be read, is not JSON, or breaks the schema.
    """
    try:
        text = file.read_text(encoding="utf-8-sig")  # some editors put a byte-order mark
        header = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_refuse_duplicates)
        # Half of a surrogate pair ("\ud800") is valid JSON, but nobody can print or save it.
        json.dumps(header, ensure_ascii=False).encode("utf-8")
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}): check the file") from error
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{file}: is not valid JSON ({_first_line(error)}): mend it in a text editor"
        ) from error
    check_header(header, file)
    return header


def check_header(header: Any, file: Path) -> None:
    """Check what recording.json holds.

    Raises:
        InputError: On the first key that is unknown, missing, of the wrong type or out of range.
    """
    if not isinstance(header, dict):
        raise InputError(
            f"{file}: must hold an object in braces, not {reprlib.repr(header)}: write its keys so"
        )
    # The version comes first: another version may have other keys, which are then no mistakes.
    version = header.get("format_version")
    if version is not None and (isinstance(version, bool) or version != FORMAT_VERSION):
        raise InputError(
            f"{file}: format_version is {reprlib.repr(version)}, but this slapshot reads version "
            f"{FORMAT_VERSION}: write the recording in that version, or use a newer slapshot"
        )
    errors = Draft202012Validator(RECORDING_SCHEMA).iter_errors(header)
    first = min(errors, key=lambda error: [str(part) for part in error.absolute_path], default=None)
    if first is not None:
        raise InputError(f"{file}: {_explain(first)}")


def header_of(recording: Recording) -> dict[str, Any]:
    """The contents of recording.json for a recording; optional keys without a value are absent."""
    header: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "rig": recording.rig,
        "objects": {
            object_id: {
                "shape": info.shape,
                "size_m": list(info.size_m),
                "mass_kg": info.mass_kg,
                "mass_sd_kg": info.mass_sd_kg,
            }
            for object_id, info in recording.objects.items()
        },
        "camera_rate_hz": recording.camera_rate_hz,
        "frame_note": recording.frame_note,
        "stand_in": recording.stand_in,
        "note": recording.note,
    }
    if recording.trajectory_model is not None:
        header["trajectory_model"] = recording.trajectory_model
    if recording.sealed_truth_sha256 is not None:
        header["sealed_truth_sha256"] = recording.sealed_truth_sha256
    return header


def objects_of(header: dict[str, Any]) -> dict[str, ObjectInfo]:
    """The objects of a checked header, by object_id."""
    return {
        object_id: ObjectInfo(
            shape=info["shape"],
            size_m=tuple(float(extent) for extent in info["size_m"]),
            mass_kg=float(info["mass_kg"]),
            mass_sd_kg=float(info["mass_sd_kg"]),
        )
        for object_id, info in header["objects"].items()
    }


def _explain(error: ValidationError) -> str:
    """One line that names the key and what to do, for the first thing the schema refuses."""
    path = [part if isinstance(part, str) else f"[{part}]" for part in error.absolute_path]
    key = ".".join(path).replace(".[", "[")
    # Typed as Any, for the stubs allow each of them to be unset until the error is complete.
    instance: Any = error.instance
    schema: Any = error.schema
    limit: Any = error.validator_value
    if error.validator == "additionalProperties":
        known = schema["properties"]
        unknown = sorted(set(instance) - set(known))[0]
        return (
            f"unknown key {_dotted(key, unknown)!r}: remove it or correct its spelling "
            f"(known: {', '.join(known)})"
        )
    if error.validator == "required":
        missing = next(name for name in limit if name not in instance)
        meaning = schema["properties"][missing]["description"]
        return f"key {_dotted(key, missing)!r} is missing: add it ({meaning})"
    if error.validator == "type":
        types = [limit] if isinstance(limit, str) else limit
        wanted = " or ".join(_TYPE_WORDS[name] for name in types)
    else:
        wanted = _LIMIT_WORDS[str(error.validator)].format(limit)
    meaning = f" ({schema['description']})" if "description" in schema else ""
    return f"key {key!r} must be {wanted}, not {reprlib.repr(instance)}: correct it{meaning}"


def _dotted(parent: str, key: str) -> str:
    return f"{parent}.{key}" if parent else key


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _refuse_constant(word: str) -> float:
    """Refuse NaN and Infinity, which Python's reader takes although JSON has no such numbers."""
    raise ValueError(f"{word} is not a JSON number")


def _refuse_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a key that stands twice, of which Python's reader would silently keep the last."""
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ValueError(f"key {key!r} stands there twice")
        result[key] = value
    return result
