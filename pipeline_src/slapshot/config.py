"""Configuration: default.yaml, a file that changes parts of it, and the check of both together."""

import difflib
import math
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import jsonschema

from slapshot.errors import InputError
from slapshot.scenes.randomisation import CONDITION_PARAMETERS
from slapshot.yaml_file import read_yaml

DEFAULT_CONFIG = Path("config/default.yaml")
SCHEMA = Path("workflow/schemas/config.schema.yaml")

_NAME = re.compile(r"[A-Za-z0-9_-]+")  # of a domain or recording: it becomes part of file names
_SAFE_SPREADS = 5  # a normal draw is taken to stay within so many standard deviations
_INT64_LIMIT = 2**63
_CONTROL_PERIOD = 0.001  # s; commands are sent at whole steps of integration

# JSON's integers include 4.0, which range() refuses.
_Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator,
    type_checker=jsonschema.Draft202012Validator.TYPE_CHECKER.redefine(
        "integer", lambda _, value: isinstance(value, int) and not isinstance(value, bool)
    ),
)


def load_config(path: Path | None = None, schema: Path = SCHEMA) -> dict[str, Any]:
    """Default configuration with the values of `path` laid over it, checked.

    Args:
        path: a YAML file with the keys that differ from the default; None for the default itself.
        schema: JSON schema, in YAML.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed.
    """
    if not DEFAULT_CONFIG.is_file():
        raise InputError(f"{DEFAULT_CONFIG}: no such file; run this in the top folder of the repository")
    config = read_yaml(DEFAULT_CONFIG)
    if path is not None and path.resolve() != DEFAULT_CONFIG.resolve():
        config = merge(config, read_yaml(path))
    check_config(config, str(path or DEFAULT_CONFIG), schema)
    return config


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Values of `over` laid over `base`, mapping by mapping, as Snakemake does with --configfile."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            value = merge(old, value)
        merged[key] = value
    return merged


def check_config(config: Mapping[str, Any], source: str, schema: Path = SCHEMA) -> None:
    """Hold a configuration against the schema and against what a schema cannot say.

    Raises:
        InputError: naming the key, what is wrong with it and what would be right.
    """
    errors = sorted(
        _Validator(read_yaml(schema)).iter_errors(_checked_values(config, source)),
        key=lambda e: (-len(e.absolute_path), [str(part) for part in e.absolute_path]),
    )
    if errors:
        raise InputError(f"{source}: {_explain(errors[0])}")
    for name, domain in config["domains"].items():
        for key, problem in _impossible(name, domain):
            raise InputError(f"{source}: domains.{name}{key and '.'}{key}: {problem}")


def _checked_values(value: Any, source: str, path: tuple[str, ...] = ()) -> Any:
    """The value itself, once it holds nothing but what JSON can say."""
    where = f"{source}: {'.'.join(path) or 'top level'}"
    if isinstance(value, Mapping):
        for key, item in value.items():
            if not isinstance(key, str):
                raise InputError(f"{where}: key {_short(key)} is not a text; write it in quotes")
            if not _one_line(key).isprintable():
                raise InputError(f"{where}: key {_short(key)} has an unprintable character; remove it")
            _checked_values(item, source, (*path, _one_line(key)))
    elif isinstance(value, list):
        for i, item in enumerate(value):
            _checked_values(item, source, (*path, str(i)))
    elif isinstance(value, str) and not _one_line(value).isprintable():
        raise InputError(f"{where}: {_short(value)} has an unprintable character; remove it")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{where}: {value} is not a finite number; write one")
    elif isinstance(value, int) and abs(value) >= _INT64_LIMIT:
        raise InputError(f"{where}: the number has more than 18 digits; write a smaller one")
    elif value is not None and not isinstance(value, str | int | float):
        raise InputError(f"{where}: {_short(value)} is a {type(value).__name__}; write it in quotes")
    return value


_TYPES = {"object": "mapping", "array": "list", "string": "text", "integer": "whole number"}
_LONG_LIST = 10  # longer ones do not fit into a message
_BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


def _explain(error: jsonschema.ValidationError) -> str:
    key = ".".join(_one_line(str(part)) for part in error.absolute_path) or "top level"
    return f"{key}: {_problem(error)}"


def _problem(error: jsonschema.ValidationError) -> str:
    """What is wrong with a value and what would be right, in one line."""
    kind: Any = error.validator
    value: Any = error.validator_value
    schema: Any = error.schema
    instance: Any = error.instance
    shown = _short(instance)
    if kind == "additionalProperties":
        patterns = (p.strip("^").partition("(")[0] for p in schema.get("patternProperties", {}))
        known = sorted([*schema.get("properties", {}), *patterns])
        unknown = min(k for k in instance if k not in known and not _matches(k, schema))
        close = difflib.get_close_matches(unknown, known, n=1)
        meant = f"write {close[0]!r}" if close else "remove it"
        return f"unknown key {unknown!r}; {meant}, or use one of: {', '.join(known)}"
    if kind == "required":
        missing = next(k for k in value if k not in instance)
        return f"key {missing!r} is missing; add it"
    if kind == "anyOf":
        # Of the case that the value comes nearest to: one that it has the type of.
        return _problem(min(error.context, key=lambda e: (e.validator == "type", len(e.path))))
    if kind == "const":
        return f"{shown} is not allowed; write {value!r}"
    if kind == "type":
        wanted = " or ".join(_TYPES.get(t, t) for t in ([value] if isinstance(value, str) else value))
        hint = f" such as {float(instance)!r}" if _is_number(instance) and value == "number" else ""
        return f"{shown} is not a {wanted}; write a {wanted}{hint}"
    if kind in _BOUNDS:
        return f"{shown} is out of range; it must be {_BOUNDS[kind]} {value}"
    if kind == "enum" and len(value) > _LONG_LIST:
        close = difflib.get_close_matches(str(instance), value)
        return f"{shown} is not allowed; {'write ' + close[0] if close else f'see {SCHEMA} for what is'}"
    if kind == "enum":
        return f"{shown} is not allowed; use one of: {', '.join(map(str, value))}"
    if kind == "oneOf" and all(set(case) == {"required"} for case in value):
        names = [name for case in value for name in case["required"]]
        found = [name for name in names if name in instance]
        return f"has {' and '.join(found) or 'none'} of {', '.join(names)}; give exactly one of them"
    if kind in {"minItems", "maxItems"}:
        limit = f"at {'least' if kind == 'minItems' else 'most'} {value}"
        return f"{shown} has {len(instance)} values; write {limit}"
    if kind == "minProperties":
        return f"is empty; add at least {value}"
    if kind == "uniqueItems":
        return f"{shown} names something twice; name it once"
    if kind == "pattern":
        return f"{shown} has a character that is not allowed; it must match {value}"
    return f"{_one_line(error.message)}; see {SCHEMA}"


def _matches(key: str, schema: Mapping[str, Any]) -> bool:
    return any(re.search(pattern, key) for pattern in schema.get("patternProperties", {}))


def _is_number(value: Any) -> bool:
    """True for what YAML takes for a text although a person reads a number, such as 1e-3."""
    try:
        return isinstance(value, str) and math.isfinite(float(value))
    except ValueError:
        return False


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _short(value: Any) -> str:
    text = _one_line(repr(value))
    return text if len(text) <= 60 else f"{text[:57]}..."


def _impossible(name: str, domain: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Key and problem of values that are impossible although the schema allows each alone."""
    for key, names in (("", [name]), ("recordings", domain["recordings"])):
        for bad in (n for n in names if not _NAME.fullmatch(n)):
            yield key, f"{bad!r} is no good name; use letters, digits, _ and -"
    period = _CONTROL_PERIOD / domain["scene"].get("timestep_s", _CONTROL_PERIOD)
    if not (math.isfinite(period) and math.isclose(period, round(period), rel_tol=1e-6)):
        yield (
            "scene.timestep_s",
            (
                f"{domain['scene']['timestep_s']} does not divide {_CONTROL_PERIOD} s; "
                "use 0.001, 0.0005, 0.00025 or another whole part"
            ),
        )
    for parameter, spec in domain["randomisation"].items():
        for key, problem in _impossible_distribution(parameter, spec):
            yield f"randomisation.{parameter}.{key}", problem
    place = domain["demonstrations"].get("place_m", [0, 0, 0, 0])
    if place[0] > place[1] or place[2] > place[3]:
        yield (
            "demonstrations.place_m",
            f"{place} runs backwards; write lowest x, highest x, lowest y, highest y",
        )
    low, high = domain["demonstrations"]["speed_m_s"]
    if not 0 < low <= high:
        yield "demonstrations.speed_m_s", f"[{low}, {high}] is no range of speeds; write 0 < low <= high"
    hits = domain["rollouts"]["hits"]
    for condition, values in domain["rollouts"]["named_conditions"].items():
        for unknown in sorted(set(values) - set(CONDITION_PARAMETERS)):
            yield (
                f"rollouts.named_conditions.{_one_line(condition)}",
                (f"unknown parameter {unknown!r}; use one of: {', '.join(CONDITION_PARAMETERS)}"),
            )
    needed = domain["evaluation"]["samples"] + domain["evaluation"]["queries"]
    if needed > hits:
        yield (
            "evaluation",
            (
                f"samples + queries = {needed} hits of a condition, but rollouts.hits is {hits}; "
                "lower the first or raise the second"
            ),
        )
    if domain["training"]["sequence"] > hits:
        yield (
            "training.sequence",
            (
                f"{domain['training']['sequence']} is more than rollouts.hits = {hits}; "
                "lower the first or raise the second"
            ),
        )


def _impossible_distribution(parameter: str, spec: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if "uniform" in spec and spec["uniform"][0] > spec["uniform"][1]:
        yield "uniform", f"{spec['uniform']} runs backwards; write [low, high] with low <= high"
    if "normal" in spec:
        mean, spread = spec["normal"]
        if spread < 0:
            yield "normal", f"standard deviation {spread} is negative; write [mean, sd] with sd >= 0"
        if parameter in CONDITION_PARAMETERS and mean - _SAFE_SPREADS * spread <= 0:
            yield (
                "normal",
                (
                    f"{spec['normal']} draws values below 0, which {parameter} cannot have; "
                    f"write a mean above {_SAFE_SPREADS} standard deviations, or use uniform"
                ),
            )
    if "times" in spec:
        earlier: Collection[str] = ()
        if parameter in CONDITION_PARAMETERS:
            earlier = CONDITION_PARAMETERS[: CONDITION_PARAMETERS.index(parameter)]
        if spec["times"] not in earlier:
            advice = f"use one of: {', '.join(earlier)}" if earlier else "leave `times` out"
            yield "times", f"no parameter {spec['times']!r} is drawn before {parameter}; {advice}"
