"""Validation of files from outside with pydantic models, with one-line error messages.

A model defines the keys that a file may have, with types, bounds and descriptions. `validated` turns values
into the model, or raises an InputError that says where (file and line), what is wrong, and how to fix it.
"""

import difflib
import json
import math
import re
import reprlib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from slapshot.errors import InputError, reading
from slapshot.text import printable
from slapshot.yaml_file import Loc

LONGEST_NAME = 64
# Names become parts of file names and command lines, so the whole name must match.
NAME = rf"^[A-Za-z0-9][A-Za-z0-9_-]{{0,{LONGEST_NAME - 1}}}$"
NAME_MEANS = f"letters, digits, _ and -, the first a letter or digit, at most {LONGEST_NAME}"
# Titles are only for people, such as labels in figures.
TITLE = rf"^[A-Za-z0-9][A-Za-z0-9 _-]{{0,{LONGEST_NAME - 1}}}$"
# Labels are drawn by matplotlib, in which $ and \ would begin a formula.
LABEL = r"^[^$\\]*$"
_MEANS = {
    NAME: NAME_MEANS,
    TITLE: NAME_MEANS.replace("digits,", "digits, spaces,"),
    LABEL: "characters other than $ and \\",
}

_DEEPEST = 50  # nesting depth, far more than any file needs
_LONG_LIST = 10  # longer ones do not fit into a message
_LARGEST_INTEGER = 2**63
_TYPES = {
    "object": "mapping",
    "array": "list",
    "string": "text",
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "null": "null",
}
_OF_PYDANTIC = {
    "int": "integer",
    "float": "number",
    "string": "string",
    "bool": "boolean",
    "list": "array",
    "tuple": "array",
    "dict": "object",
    "model": "object",
    "dataclass": "object",
    "model_attributes": "object",
    "mapping": "object",
}
_BOUNDS = {
    "greater_than": (">", "gt"),
    "greater_than_equal": (">=", "ge"),
    "less_than": ("<", "lt"),
    "less_than_equal": ("<=", "le"),
}


class Model(BaseModel):
    """Base of what files may say: unknown keys are refused, values are not converted, numbers are finite."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, protected_namespaces=()
    )

    @classmethod
    def from_parts(cls, *parts: BaseModel, **values: Any) -> Self:
        """This model with the values that other models have for its keys, and further values.

        Args:
            parts: models; keys that are unset in all of them remain unset.
            values: override those of the parts.

        Raises:
            ValueError: two parts have values for the same key.
        """
        said: dict[str, Any] = {}
        for part in parts:
            own = {key: getattr(part, key) for key in cls.model_fields if key in part.model_fields_set}
            twice = own.keys() & said.keys() - values.keys()
            if twice:
                raise ValueError(f"{cls.__name__}: two parts say {', '.join(sorted(twice))}")
            said |= own
        return cls(**said | values)


class ProblemAtError(ValueError):
    """A problem with a value, as `what; remedy`, and the value's location relative to the validated model.

    Raised by a model that compares several values; `validated` adds the location in the file.
    """

    def __init__(self, loc: Loc, problem: str) -> None:
        super().__init__(problem)
        self.loc = loc


M = TypeVar("M", bound=BaseModel)


def validated(model: type[M], values: Any, where: Callable[[Loc], str] | Path | str) -> M:
    """Validate values read from a file.

    Args:
        model: of the file.
        values: from YAML or JSON.
        where: file and line of a location in the values, or only the file.

    Raises:
        InputError: the values are invalid; one line says where, what is wrong, and what would be right.
    """
    told = where if callable(where) else (lambda loc: str(where))
    check_plain(values, told)
    try:
        # From JSON, so that a model may have tuples and dataclasses; nothing else is converted.
        return model.model_validate_json(json.dumps(values))
    except ValidationError as error:
        problem = _first_problem(error, model, values)
        raise InputError(f"{told(problem.loc)}: {key_of(problem.loc)}: {problem}") from None


def values_of(model: BaseModel) -> dict[str, Any]:
    """Values of a model as JSON types, which `validated` accepts; unset keys are left out."""
    return model.model_dump(mode="json", exclude_unset=True)


def validated_part(model: type[M], values: Any, loc: Loc) -> M:
    """Validate a part of a model, at `loc`, where other values of that model decide on the part's type.

    Raises:
        ProblemAtError: the part is invalid.
    """
    try:
        return model.model_validate_json(json.dumps(values))
    except ValidationError as error:
        problem = _first_problem(error, model, values)
        raise ProblemAtError((*loc, *problem.loc), str(problem)) from None


def key_of(loc: Loc) -> str:
    """Dotted keys of a location in a file."""
    return ".".join(shown_text(str(part)) for part in loc) or "top level"


def check_plain(value: Any, where: Callable[[Loc], str], loc: Loc = ()) -> None:
    """Refuse values that YAML and JSON allow but models cannot handle.

    Raises:
        InputError: a key that is no text, an infinite or huge number, a date, an unprintable character, or
            values nested too deeply.
    """
    problem = None
    if len(loc) > _DEEPEST:
        raise InputError(f"{where(loc)}: {key_of(loc[:3])}: holds more than {_DEEPEST} levels; remove some")
    if isinstance(value, Mapping):
        for key, item in value.items():
            if not isinstance(key, str):
                raise InputError(
                    f"{where(loc)}: {key_of(loc)}: key {short(key)} is not a text; write it in quotes"
                )
            if not shown_text(key, whole=True).isprintable():
                raise InputError(
                    f"{where(loc)}: {key_of(loc)}: key {short(key)} has an unprintable character; remove it"
                )
            check_plain(item, where, (*loc, key))
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            check_plain(item, where, (*loc, i))
    elif isinstance(value, str) and not shown_text(value, whole=True).isprintable():
        problem = f"{short(value)} has an unprintable character; remove it"
    elif isinstance(value, float) and not math.isfinite(value):
        problem = f"{value} is not a finite number; write one"
    elif isinstance(value, int) and abs(value) >= _LARGEST_INTEGER:
        problem = "the number has more than 18 digits; write a smaller one"
    elif value is not None and not isinstance(value, str | int | float):
        problem = f"{short(value)} is a {type(value).__name__}; write it in quotes"
    if problem is not None:
        raise InputError(f"{where(loc)}: {key_of(loc)}: {problem}")


def short(value: Any) -> str:
    """A value for a message: one line of at most 60 printable characters."""
    # Python refuses to print an integer of many thousand digits.
    text = printable(" ".join((reprlib.repr(value) if isinstance(value, int) else repr(value)).split()))
    return text if len(text) <= 60 else f"{text[:57]}..."


def shown_text(text: str, whole: bool = False) -> str:
    """A text on one line; shortened unless `whole`."""
    line = " ".join(text.split())
    return line if whole or len(line) <= 60 else f"{line[:57]}..."


def _first_problem(error: ValidationError, model: type[BaseModel], values: Any) -> ProblemAtError:
    """The error to report: the most deeply nested one, which is the most specific."""
    found = []
    for detail in error.errors(include_url=False):
        loc, tagged = _real_loc(detail["loc"], values, detail["type"] == "missing")
        inner = detail.get("ctx", {}).get("error")
        if isinstance(inner, ProblemAtError):
            loc = (*loc, *inner.loc)
        mistyped = detail["type"].endswith("_type") or detail["type"] == "none_required"
        # For a union, prefer the case whose type the value has.
        found.append((tagged and mistyped, -len(loc), [str(part) for part in loc], loc, detail))
    found.sort(key=lambda item: item[:3])
    loc, detail = found[0][3:]
    wanted = [d for *_, own, d in found if own == loc and d["type"].endswith("_type")]
    return ProblemAtError(*_described(detail, wanted, loc, _schema_of(model)))


@cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _real_loc(loc: tuple[int | str, ...], values: Any, missing: bool) -> tuple[Loc, bool]:
    """Keys and indices of a location, without the names of union cases, and whether it ends with such a name.

    The last key of a `missing` value does not exist in the values.
    """
    real: list[int | str] = []
    here, tagged = values, False
    for i, part in enumerate(loc):
        in_list = isinstance(here, list | tuple) and isinstance(part, int) and part < len(here)
        tagged = False
        if in_list or (isinstance(here, Mapping) and part in here):
            here = here[part]
            real.append(part)
        elif missing and i == len(loc) - 1:
            real.append(part)
        else:
            tagged = part != "[key]"
    return tuple(real), tagged


def _described(
    detail: Any, mistyped: list[Any], loc: Loc, schema: dict[str, Any]
) -> tuple[Loc, str]:  # a missing or unknown key is reported at the mapping that holds it
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    shown = short(value)
    own = list(_schemas_at(schema, loc, schema))
    meaning = next((s["description"] for s in own if "description" in s), None)
    # Only the first line of a docstring.
    hint = f" ({meaning.splitlines()[0]})" if meaning else ""
    if kind in {"extra_forbidden", "unexpected_keyword_argument"}:
        key = str(loc[-1])
        known = sorted(
            {k for s in _schemas_at(schema, loc[:-1], schema) for k in s.get("properties", {})} - {key}
        )
        close = difflib.get_close_matches(key, known, n=1)
        meant = f"write {close[0]!r}" if close else "remove it"
        return loc, f"unknown key {short(key)}; {meant}, or use one of: {', '.join(known)}"
    if kind == "missing" and isinstance(detail["loc"][-1], int):  # of a tuple
        loc = loc[:-1] if loc[-1:] == detail["loc"][-1:] else loc
        parts = list(_schemas_at(schema, loc, schema))
        length = next(s["minItems"] for s in parts if "minItems" in s)
        meaning = next((s["description"] for s in parts if "description" in s), None)
        return loc, f"{shown} has {len(value)} values; write {length}{f' ({meaning})' if meaning else ''}"
    if kind == "missing":
        return loc[:-1], f"key {str(loc[-1])!r} is missing; add it{hint}"
    if kind.endswith("_type") or kind == "none_required":
        names = [_TYPES[_OF_PYDANTIC[d["type"].removesuffix("_type")]] for d in mistyped] or ["null"]
        if any(s.get("type") == "null" for s in own):
            names.append(_TYPES["null"])
        wanted = " or ".join(dict.fromkeys(names))
        like = f" such as {float(value)!r}" if _is_number(value) and "number" in names else ""
        return loc, f"{shown} is not a {wanted}; write a {wanted}{like}{hint}"
    if kind in _BOUNDS:
        sign, name = _BOUNDS[kind]
        return loc, f"{shown} is out of range; it must be {sign} {context[name]:g}{hint}"
    if kind == "literal_error":
        allowed = [str(v) for s in own for v in s.get("enum", [s["const"]] if "const" in s else [])]
        if len(allowed) > _LONG_LIST:
            close = difflib.get_close_matches(str(value), allowed, n=1)
            return (
                loc,
                f"{shown} is not allowed; write {close[0] if close else 'one of ' + ', '.join(allowed)}",
            )
        return loc, f"{shown} is not allowed; use one of: {', '.join(allowed)}{hint}"
    if kind in {"too_short", "too_long"}:
        few = kind == "too_short"
        limit = context["min_length" if few else "max_length"]
        if isinstance(value, Mapping) and few:
            return loc, f"is empty; add at least {limit}{hint}"
        return loc, f"{shown} has {len(value)} values; write at {'least' if few else 'most'} {limit}{hint}"
    if kind == "string_too_short":
        return loc, f"{shown} is empty; write a text{hint}"
    if kind == "string_too_long":
        return loc, f"{shown} has {len(value)} characters; write at most {context['max_length']}{hint}"
    if kind == "string_pattern_mismatch":
        means = _MEANS.get(context["pattern"], f"what matches {context['pattern']}")
        return loc, f"{shown} is not allowed; use {means}{hint}"
    if kind == "value_error":
        return loc, str(context["error"])
    return loc, f"{' '.join(detail['msg'].split())}, not {shown}; correct it{hint}"


def _schemas_at(schema: Any, loc: Loc, root: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Every part of a JSON schema that applies to a location."""
    if not isinstance(schema, dict):
        return
    if "$ref" in schema:
        # Keywords beside a reference are more specific than the schema that it refers to.
        if not loc:
            yield {k: v for k, v in schema.items() if k != "$ref"}
        yield from _schemas_at(root["$defs"][schema["$ref"].rpartition("/")[2]], loc, root)
        return
    if not loc:
        yield schema
    for case in (*schema.get("anyOf", []), *schema.get("oneOf", []), *schema.get("allOf", [])):
        yield from _schemas_at(case, loc, root)
    if loc:
        part = loc[0]
        patterns = (s for p, s in schema.get("patternProperties", {}).items() if re.search(p, str(part)))
        inner = schema.get("properties", {}).get(part) or next(patterns, schema.get("additionalProperties"))
        if isinstance(part, int):
            first = schema.get("prefixItems", [])
            inner = first[part] if part < len(first) else schema.get("items")
        yield from _schemas_at(inner, loc[1:], root)


def _is_number(value: Any) -> bool:
    """True for text that a person reads as a number but YAML does not, such as 1e-3."""
    try:
        return isinstance(value, str) and math.isfinite(float(value))
    except ValueError:
        return False


def read_json(path: Path, remedy: str, longest: int = 64_000_000) -> Any:
    """Read a JSON file; repeated keys, NaN and infinities are refused.

    Args:
        path: of the file.
        remedy: what to do if it cannot be read.
        longest: maximum size in bytes.

    Raises:
        InputError: it cannot be read or is no JSON.
    """
    with reading(path, remedy, longest):
        data = path.read_bytes()
    try:
        value = json.loads(
            data.decode("utf-8-sig"), parse_constant=_refuse_constant, object_pairs_hook=_refuse_repeats
        )
        # A lone surrogate ("\ud800") is valid JSON, but cannot be encoded in UTF-8.
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except (ValueError, RecursionError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise InputError(
            f"{path}: is not valid JSON ({printable(lines[0])}): mend it in a text editor"
        ) from None
    return value


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not a JSON number")


def _refuse_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"key {key!r} stands there twice")
        found[key] = value
    return found
