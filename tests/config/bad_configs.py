"""Bad configurations by the hundred: whatever the models bound, overstepped key by key."""

import copy
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slapshot.config.configuration import Configuration
from slapshot.validation import NAME, key_of
from slapshot.yaml_file import Loc, read_yaml

ROOT = Path(__file__).parents[2]
DEFAULT = read_yaml(ROOT / "config/default.yaml")
DELETE = object()
SCHEMA = Configuration.model_json_schema()
_MODULE = SCHEMA["$defs"]["OwnScene"]["properties"]["domain"]["pattern"]

# What a YAML file may hold where something else belongs.
_OTHERS: dict[str, tuple[Any, ...]] = {
    "integer": ("many", 2.5, True, None, [1], {"a": 1}, "12"),
    "number": ("1e-3", True, None, [], {"a": 1}, "a lot"),
    "string": (7, 2.5, False, None, ["a"], {"a": "b"}),
    "array": (3, "abc", None, {"a": 1}, True),
    "object": (3, "abc", None, [1], True),
    "boolean": (3, 0.5, "maybe", None, [True], {"a": True}),
}
_BAD_NAMES = ("-rf", "", "a b", "a/b", "../up", "x" * 65, "ä", "name\n", " a", "_a", ".", "a;b", "$(a)")
_BAD_TITLES = ("-rf", "", "<b>", "x" * 65, "a\nb", "\x1b[31m", "a|b", " a")


@dataclass(frozen=True)
class Bad:
    """One mistake.

    Attributes:
        loc: of the value that is set or deleted.
        value: DELETE for a key that is missing.
        told: place that a message must name; where nothing is said, that of the value, or of what lacks it.
    """

    loc: Loc
    value: Any
    told: Loc | None = None

    def config(self) -> dict[str, Any]:
        """The whole configuration, with the mistake in it."""
        config = copy.deepcopy(base())
        place: Any = config
        for part in self.loc[:-1]:
            place = place[part]
        if self.value is DELETE:
            del place[self.loc[-1]]
        else:
            place[self.loc[-1]] = copy.deepcopy(self.value)
        return config

    @property
    def place(self) -> str:
        """As a message names it."""
        told = self.told if self.told is not None else self.loc[:-1] if self.value is DELETE else self.loc
        return key_of(told)

    def __str__(self) -> str:
        return f"{'.'.join(map(str, self.loc))}={'(missing)' if self.value is DELETE else repr(self.value)}"[
            :90
        ]


def base() -> dict[str, Any]:
    """A good configuration that holds every key there is, but those of a recording of one's own."""
    config = copy.deepcopy(DEFAULT)
    del config["domains"]["fetchslide"]
    hockey = config["domains"]["hockey"]
    hockey["demonstrations"]["place_m"] = [0.0, 1.0, 0.0, 1.0]
    hockey["recordings"]["lab"]["lab"]["concealed"] = [
        {"kind": "tilt", "amplitude": [0.01, 0.02]},
        {"kind": "curl", "displacement": 1.0},
    ]
    scripted = {k: v for k, v in hockey["demonstrations"].items() if k not in {"count", "place_m"}}
    hockey["recordings"]["scripted"] = copy.deepcopy(hockey["recordings"]["lab"])
    hockey["recordings"]["scripted"]["lab"]["commands"] = {"diverse": copy.deepcopy(scripted)}
    return config


def mistakes() -> Iterator[Bad]:
    """One for every bound, type and key that the models know."""
    for bad in _inside(base(), SCHEMA, ()):
        if "scripted" not in bad.loc[:-1] or "commands" in bad.loc:  # all else of it is as in `lab`
            yield bad


def _inside(value: Any, schema: dict[str, Any], loc: Loc) -> Iterator[Bad]:
    schema, cases = _case(schema, value)
    kind = schema["type"]
    if loc:
        others = [o for o in _OTHERS[kind] if o is not None and not ("number" in cases and type(o) is int)]
        # One of them for each key; all of them over all keys.
        yield Bad(loc, others[len(key_of(loc)) % len(others)])
        yield from () if "null" in cases else [Bad(loc, None)]
    if kind != "boolean":
        yield from {"object": _mapping, "array": _list, "string": _text}.get(kind, _number)(
            value, schema, loc
        )


def _case(schema: dict[str, Any], value: Any) -> tuple[dict[str, Any], set[str]]:
    """The schema of a value of that type, and all types that may stand there."""
    if "$ref" in schema:
        return _case(SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]], value)
    cases = schema.get("anyOf") or schema.get("oneOf")
    if cases is None:
        return schema, {schema["type"]}
    found = [_case(case, value)[0] for case in cases]
    fitting = next(case for case in found if _fits(case, value))
    return fitting, {case["type"] for case in found}


def _fits(schema: dict[str, Any], value: Any) -> bool:
    kind = schema.get("type")
    if isinstance(value, dict):
        domain = schema.get("properties", {}).get("domain", {})
        return kind == "object" and domain.get("const") in (None, value.get("domain"))
    if isinstance(value, list):
        return kind == "array"
    if isinstance(value, str):
        return kind == "string" and value in schema.get("enum", [schema.get("const", value)])
    return kind in {"number", "integer"}


def _mapping(value: dict[str, Any], schema: dict[str, Any], loc: Loc) -> Iterator[Bad]:
    properties, patterns = schema.get("properties", {}), schema.get("patternProperties", {})
    for key in schema.get("required", []):
        yield Bad((*loc, key), DELETE)
    if schema.get("additionalProperties") is False:
        yield Bad((*loc, "nonsense"), 1)
        for key in (k for k in list(value)[:1] if not patterns):
            yield Bad((*loc, f"{key}x"), value[key])
    if schema.get("minProperties"):
        yield Bad(loc, {})
    if patterns:
        example = next(iter(value.values()))
        names = _BAD_TITLES if " " in next(iter(patterns)) else _BAD_NAMES
        yield from (Bad((*loc, name), example) for name in names if name.isprintable())
    for key, item in value.items():
        inner = properties.get(key) or next((s for p, s in patterns.items() if re.search(p, key)), None)
        if isinstance(inner, dict):
            yield from _inside(item, inner, (*loc, key))


def _list(value: list[Any], schema: dict[str, Any], loc: Loc) -> Iterator[Bad]:
    if schema.get("minItems"):
        yield Bad(loc, [])
        yield Bad(loc, value[: schema["minItems"] - 1])
    if schema.get("maxItems", 10_001) <= 10_000 and value:
        yield Bad(loc, [value[0]] * (schema["maxItems"] + 1))
    if schema.get("uniqueItems") and value:
        yield Bad(loc, [value[0], value[0]])
    if value:
        yield from _inside(value[0], schema.get("items") or schema["prefixItems"][0], (*loc, 0))


def _text(value: str, schema: dict[str, Any], loc: Loc) -> Iterator[Bad]:
    if "enum" in schema or "const" in schema:
        yield from (Bad(loc, text) for text in ("nonsense", "", value.upper()))
    elif schema.get("pattern") in {NAME, _MODULE}:
        yield from (Bad(loc, text) for text in _BAD_NAMES if loc[-1] == "name" or len(text) in {0, 3, 65})
    else:
        yield from [Bad(loc, "$m"), Bad(loc, "\\mu")] if "pattern" in schema else []
        yield Bad(loc, "x" * (schema["maxLength"] + 1))
        yield from [Bad(loc, "")] if schema.get("minLength") else []


def _number(value: float, schema: dict[str, Any], loc: Loc) -> Iterator[Bad]:
    whole = schema["type"] == "integer"
    (low,) = {"minimum", "exclusiveMinimum"} & set(schema)
    (high,) = {"maximum", "exclusiveMaximum"} & set(schema)
    yield Bad(loc, schema[low] if low == "exclusiveMinimum" else schema[low] - 1)
    yield Bad(loc, schema[high] if high == "exclusiveMaximum" else schema[high] + 1)
    odd = (10**12, -(10**12), 10**30) if whole else (math.nan, math.inf, -math.inf, 1e300)
    yield Bad(loc, odd[len(key_of(loc)) % len(odd)])
