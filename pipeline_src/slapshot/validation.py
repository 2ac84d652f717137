"""What every file from outside is checked with: pydantic models, and one line for what is wrong.

A model says which keys a file may have, with types, bounds and descriptions. `validated` turns what was read
into the model, or raises an InputError that says where (file and line), what, and how to mend it.
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
# Matched whole: a name becomes part of file names and of command lines.
NAME = rf"^[A-Za-z0-9][A-Za-z0-9_-]{{0,{LONGEST_NAME - 1}}}$"
NAME_MEANS = f"letters, digits, _ and -, the first a letter or digit, at most {LONGEST_NAME}"
# Of what only people read, such as a label in a figure.
TITLE = rf"^[A-Za-z0-9][A-Za-z0-9 _-]{{0,{LONGEST_NAME - 1}}}$"
# Of what a picture shows, in which $ and \ would begin a formula.
LABEL = r"^[^$\\]*$"
_MEANS = {
    NAME: NAME_MEANS,
    TITLE: NAME_MEANS.replace("digits,", "digits, spaces,"),
    LABEL: "characters other than $ and \\",
}

_DEEPEST = 50  # levels of values in each other, far beyond any use
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
        """This model with what others say of its keys, and further values.

        Args:
            parts: models; what they leave out stays out.
            values: count more than any part.

        Raises:
            ValueError: two parts say something of the same key.
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
    """What is wrong with a value, and where it stands below what is checked: `what; remedy`.

    Raised by a model that holds several values against each other; `validated` tells the place of it.
    """

    def __init__(self, loc: Loc, problem: str) -> None:
        super().__init__(problem)
        self.loc = loc


M = TypeVar("M", bound=BaseModel)


def validated(model: type[M], values: Any, where: Callable[[Loc], str] | Path | str) -> M:
    """What was read from a file, as a model.

    Args:
        model: what the file may say.
        values: what it says, as YAML or JSON has it.
        where: file and line of a place in it, or the file.

    Raises:
        InputError: one line: where, what is wrong, and what would be right.
    """
    told = where if callable(where) else (lambda loc: str(where))
    check_plain(values, told)
    try:
        # As JSON, so that a model may have tuples and dataclasses; nothing else is converted.
        return model.model_validate_json(json.dumps(values))
    except ValidationError as error:
        problem = _first_problem(error, model, values)
        raise InputError(f"{told(problem.loc)}: {key_of(problem.loc)}: {problem}") from None


def values_of(model: BaseModel) -> dict[str, Any]:
    """What a model says, as JSON has it and `validated` takes it; what it leaves out stays out."""
    return model.model_dump(mode="json", exclude_unset=True)


def validated_part(model: type[M], values: Any, loc: Loc) -> M:
    """What stands at `loc` as a model, within a model whose other values decide on which.

    Raises:
        ProblemAtError: it is not allowed.
    """
    try:
        return model.model_validate_json(json.dumps(values))
    except ValidationError as error:
        problem = _first_problem(error, model, values)
        raise ProblemAtError((*loc, *problem.loc), str(problem)) from None


def key_of(loc: Loc) -> str:
    """Dotted keys of a place in a file."""
    return ".".join(shown_text(str(part)) for part in loc) or "top level"


def check_plain(value: Any, where: Callable[[Loc], str], loc: Loc = ()) -> None:
    """Refuse what YAML and JSON can say but no model can judge.

    Raises:
        InputError: a key that is no text, an infinite or huge number, a date, an unprintable character, or
            values in each other without end.
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
    """A value in a message: one line of at most 60 printable characters."""
    # An integer of many thousand digits cannot even be printed.
    text = printable(" ".join((reprlib.repr(value) if isinstance(value, int) else repr(value)).split()))
    return text if len(text) <= 60 else f"{text[:57]}..."


def shown_text(text: str, whole: bool = False) -> str:
    """A text on one line; shortened unless `whole`."""
    line = " ".join(text.split())
    return line if whole or len(line) <= 60 else f"{line[:57]}..."


def _first_problem(error: ValidationError, model: type[BaseModel], values: Any) -> ProblemAtError:
    """The error that is worth telling: the deepest, since it says the most."""
    found = []
    for detail in error.errors(include_url=False):
        loc, tagged = _real_loc(detail["loc"], values, detail["type"] == "missing")
        inner = detail.get("ctx", {}).get("error")
        if isinstance(inner, ProblemAtError):
            loc = (*loc, *inner.loc)
        mistyped = detail["type"].endswith("_type") or detail["type"] == "none_required"
        # Of a union, the case that the value comes nearest to: one that it has the type of.
        found.append((tagged and mistyped, -len(loc), [str(part) for part in loc], loc, detail))
    found.sort(key=lambda item: item[:3])
    loc, detail = found[0][3:]
    wanted = [d for *_, own, d in found if own == loc and d["type"].endswith("_type")]
    return ProblemAtError(*_described(detail, wanted, loc, _schema_of(model)))


@cache
def _schema_of(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _real_loc(loc: tuple[int | str, ...], values: Any, missing: bool) -> tuple[Loc, bool]:
    """Keys and indices of a place without the names of a union's cases, and whether it ends with one.

    The last key of a place that is `missing` stands in no value.
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
) -> tuple[Loc, str]:  # a missing or unknown key is told of what holds it
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    shown = short(value)
    own = list(_schemas_at(schema, loc, schema))
    meaning = next((s["description"] for s in own if "description" in s), None)
    # Of a docstring, what its first line says.
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
    """Every part of a JSON schema that says something about a place."""
    if not isinstance(schema, dict):
        return
    if "$ref" in schema:
        # What stands beside a reference says more than what it refers to.
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
    """True for what YAML takes for a text although a person reads a number, such as 1e-3."""
    try:
        return isinstance(value, str) and math.isfinite(float(value))
    except ValueError:
        return False


def read_json(path: Path, remedy: str, longest: int = 64_000_000) -> Any:
    """A JSON file; repeated keys, NaN and infinities are refused.

    Args:
        path: of the file.
        remedy: what to do where it cannot be read.
        longest: bytes.

    Raises:
        InputError: it cannot be read or is no JSON.
    """
    with reading(path, remedy, longest):
        data = path.read_bytes()
    try:
        value = json.loads(
            data.decode("utf-8-sig"), parse_constant=_refuse_constant, object_pairs_hook=_refuse_repeats
        )
        # Half of a surrogate pair ("\ud800") is valid JSON, but nobody can print or save it.
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
