"""verdict.json: what it holds, how it is checked, written and read back."""

import json
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from jsonschema import Draft202012Validator

from slapshot.diagnosis.verdict import Verdict
from slapshot.effects.effect import Follows, Phase
from slapshot.errors import InputError
from slapshot.recordings.format import Kind

VERDICT_FILE = "verdict.json"

_Schema = dict[str, Any]
_NUMBER: _Schema = {"type": "number"}
_TEXT: _Schema = {"type": "string", "minLength": 1}
_YES_NO: _Schema = {"type": "boolean"}
_NOT_NEGATIVE: _Schema = {"type": "number", "minimum": 0}
_SHARE: _Schema = {"type": "number", "minimum": 0, "maximum": 1}
_COUNT: _Schema = {"type": "integer", "minimum": 0}


def _object(**properties: _Schema) -> _Schema:
    """An object with these keys, all of them and no others."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _or_null(schema: _Schema) -> _Schema:
    return {"anyOf": [schema, {"type": "null"}]}


def _list(schema: _Schema) -> _Schema:
    return {"type": "array", "items": schema}


def _mapping(schema: _Schema) -> _Schema:
    return {"type": "object", "additionalProperties": schema}


_PHASE, _VARIABLE = {"enum": list(get_args(Phase))}, {"enum": list(get_args(Follows))}
_INTERVAL = _object(value=_NUMBER, low=_NUMBER, high=_NUMBER)
_ERRORS = _object(
    track_rmse_m=_or_null(_INTERVAL),
    rest_rmse_m=_or_null(_INTERVAL),
    command_rest_rmse_m=_or_null(_INTERVAL),
    loglik_per_hit=_INTERVAL,
    chi2_per_freedom=_INTERVAL,
)
_MISMATCH = _object(found=_YES_NO, p_value=_SHARE, log_evidence=_NUMBER, shift_m=_NOT_NEGATIVE)
_LOCATION = _object(phase=_or_null(_PHASE), variable=_or_null(_VARIABLE), size=_TEXT)
_PARAMETER = _object(name=_TEXT, unit=_TEXT, value=_NUMBER, low=_NUMBER, high=_NUMBER, meaning=_TEXT)
_EFFECT = _object(
    name=_TEXT,
    phase=_PHASE,
    variable=_VARIABLE,
    members={**_mapping(_SHARE), "minProperties": 1},
    log_evidence=_NUMBER,
    shift_m=_NOT_NEGATIVE,
    parameters=_list(_PARAMETER),
    physics=_TEXT,
)
_UNKNOWN = _object(
    flagged=_YES_NO,
    phase=_or_null(_PHASE),
    variable=_or_null(_VARIABLE),
    log_evidence=_NUMBER,
    shift_m=_NOT_NEGATIVE,
)
_NEXT_HIT = _object(
    heading_rad=_NUMBER,
    speed_m_s=_NOT_NEGATIVE,
    rivals={"type": "array", "prefixItems": [_TEXT, _TEXT], "items": False, "minItems": 2},
    nats=_NUMBER,
    like_hit=_or_null({"type": "integer"}),
)
_LIMIT = _object(effect=_TEXT, parameter=_TEXT, unit=_TEXT, at_most=_NOT_NEGATIVE)
_VERDICT = _object(
    rig=_TEXT,
    kind={"enum": list(get_args(Kind))},
    stand_in=_YES_NO,
    hits=_COUNT,
    used=_COUNT,
    cannot_tell=_or_null(_TEXT),
    mismatch=_or_null(_MISMATCH),
    location=_or_null(_LOCATION),
    effects=_list(_EFFECT),
    unknown=_or_null(_UNKNOWN),
    limits=_list(_LIMIT),
    noise_sd_m=_or_null(_NOT_NEGATIVE),
    noise_time_s=_or_null(_NOT_NEGATIVE),
    friction_scatter=_or_null(_NOT_NEGATIVE),
    fit=_or_null(_object(nominal=_ERRORS, refitted=_ERRORS, augmented=_ERRORS, noise_floor=_ERRORS)),
    next_hits=_list(_NEXT_HIT),
    notes=_list(_TEXT),
    versions=_mapping(_TEXT),
)
# Either there is a verdict, or the reason why there is none.
_TOLD = {name: {"type": "object"} for name in ("mismatch", "location", "unknown", "fit")}
_UNTOLD = {name: {"type": "null"} for name in _TOLD}
VERDICT_SCHEMA: _Schema = _VERDICT | {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "Verdict of a diagnosis; SI units, 90 % intervals",
    "if": {"properties": {"cannot_tell": {"type": "null"}}},
    "then": {"properties": _TOLD},
    "else": {"properties": _UNTOLD},
}


def write_verdict(verdict: Verdict, versions: Mapping[str, str], folder: Path) -> None:
    """Check a verdict and write verdict.json.

    Args:
        verdict: numbers in it must be finite; what has no value is null.
        versions: of scene, code and recording, and whatever else it came from.
        folder: that exists.

    Raises:
        ValueError: the verdict breaks the schema, or holds NaN or an infinity.
    """
    # NumPy's numbers become JSON's; NaN and infinities raise.
    text = json.dumps({**verdict.as_dict(), "versions": dict(versions)}, indent=2, allow_nan=False)
    problem = _problem(json.loads(text))
    if problem is not None:
        raise ValueError(f"verdict: {problem}")
    (folder / VERDICT_FILE).write_text(text + "\n")


def read_verdict(folder: Path) -> tuple[Verdict, dict[str, str]]:
    """A verdict and the versions that it came from.

    Raises:
        InputError: there is no verdict.json, or it breaks the schema.
    """
    file = folder / VERDICT_FILE
    try:
        values = json.loads(file.read_text(), parse_constant=_refuse)
    except OSError as error:
        raise InputError(
            f"{file}: cannot be read ({error.strerror}): diagnose the recording first"
        ) from error
    except ValueError as error:
        raise InputError(f"{file}: is not valid JSON ({error}): diagnose the recording again") from error
    problem = _problem(values)
    if problem is not None:
        raise InputError(f"{file}: {problem}: diagnose the recording again")
    versions = values.pop("versions")
    return _from_json(Verdict, values), versions


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


def _problem(values: Any) -> str | None:
    """The first thing that breaks the schema, with its place; None if nothing does."""
    found = Draft202012Validator(VERDICT_SCHEMA).iter_errors(values)
    first = min(found, key=lambda error: [str(part) for part in error.absolute_path], default=None)
    if first is None:
        return None
    place = ".".join(str(part) for part in first.absolute_path)
    return f"{place}: {first.message}" if place else first.message


_T = TypeVar("_T")


def _from_json(kind: type[_T], value: Any) -> _T:
    """JSON turned back into what a dataclass says that it holds."""
    built: Any = _built(kind, value)
    return built


def _built(kind: Any, value: Any) -> Any:
    origin, inner = get_origin(kind), get_args(kind)
    if value is None or origin is Literal:
        return value
    if origin in (Union, types.UnionType):
        return _built(next(k for k in inner if k is not types.NoneType), value)
    if origin is tuple:
        kinds = [inner[0]] * len(value) if inner[-1] is Ellipsis else inner
        return tuple(_built(k, v) for k, v in zip(kinds, value, strict=True))
    if origin is dict:
        return {key: _built(inner[1], v) for key, v in value.items()}
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{f.name: _built(hints[f.name], value[f.name]) for f in fields(kind)})  # type: ignore[operator]
    return float(value) if kind is float else value
