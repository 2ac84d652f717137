"""Configuration: default.yaml, a file that changes parts of it, and the check of both together."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import yaml

from slapshot.errors import InputError

DEFAULT_CONFIG = Path("config/default.yaml")
SCHEMA = Path("workflow/schemas/config.schema.yaml")


def load_config(path: Path | None = None, schema: Path = SCHEMA) -> dict[str, Any]:
    """Default configuration with the values of `path` laid over it, checked.

    Args:
        path: a YAML file with the keys that differ from the default; None for the default itself.
        schema: JSON schema, in YAML.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed.
    """
    config = read_yaml(DEFAULT_CONFIG)
    if path is not None and path.resolve() != DEFAULT_CONFIG.resolve():
        config = merge(config, read_yaml(path))
    check_config(config, str(path or DEFAULT_CONFIG), schema)
    return config


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML file that holds a mapping."""
    try:
        value = yaml.safe_load(path.read_text("utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; give the path of a configuration, for example config/tiny.yaml"
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = getattr(error, "problem_mark", None)
        line = f" line {where.line + 1}:" if where is not None else ""
        raise InputError(
            f"{path}:{line} not valid YAML ({getattr(error, 'problem', error)}); mend that line"
        ) from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: holds no keys; a configuration is a mapping of keys to values")
    return value


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
    validator = jsonschema.Draft202012Validator(read_yaml(schema))
    errors = sorted(validator.iter_errors(config), key=lambda e: (-len(e.path), str(e.path)))
    if errors:
        raise InputError(f"{source}: {_explain(errors[0])}")
    for name, domain in config["domains"].items():
        _check_domain(domain, f"{source}: domains.{name}")


def _explain(error: jsonschema.ValidationError) -> str:
    key = ".".join(str(part) for part in error.absolute_path) or "top level"
    kind: Any = error.validator
    value: Any = error.validator_value
    schema: Any = error.schema
    instance: Any = error.instance
    if kind == "additionalProperties":
        known = sorted(schema.get("properties", {}))
        unknown = sorted(set(instance) - set(known))
        return f"{key}: unknown key {unknown[0]!r}; remove it, or use one of: {', '.join(known)}"
    if kind == "required":
        missing = next(k for k in value if k not in instance)
        return f"{key}: key {missing!r} is missing; add it"
    if kind == "type":
        return f"{key}: {error.instance!r} is not of type {value}; write a {value}"
    if kind in {"minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum"}:
        word = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
        return f"{key}: {error.instance!r} is out of range; it must be {word[kind]} {value}"
    if kind == "enum":
        return f"{key}: {error.instance!r} is not one of {', '.join(map(str, value))}"
    return f"{key}: {error.message}; see {SCHEMA}"


def _check_domain(domain: Mapping[str, Any], source: str) -> None:
    """Ranges that are impossible although each value alone is allowed."""
    for name, spec in domain["randomisation"].items():
        if "uniform" in spec and spec["uniform"][0] > spec["uniform"][1]:
            raise InputError(
                f"{source}.randomisation.{name}.uniform: {spec['uniform']} runs "
                "backwards; write [low, high] with low <= high"
            )
        if spec.get("times") is not None and spec["times"] not in domain["randomisation"]:
            raise InputError(
                f"{source}.randomisation.{name}.times: no parameter {spec['times']!r}; "
                f"use one of: {', '.join(domain['randomisation'])}"
            )
    for name, values in domain["rollouts"]["named_conditions"].items():
        unknown = sorted(set(values) - set(domain["randomisation"]))
        if unknown:
            raise InputError(
                f"{source}.rollouts.named_conditions.{name}: unknown parameter "
                f"{unknown[0]!r}; use one of: {', '.join(domain['randomisation'])}"
            )
    needed = domain["evaluation"]["samples"] + domain["evaluation"]["queries"]
    if needed > domain["rollouts"]["hits"]:
        raise InputError(
            f"{source}.evaluation: samples + queries = {needed} hits of a condition, but "
            f"rollouts.hits is {domain['rollouts']['hits']}; lower the first or raise the second"
        )
    if domain["training"]["sequence"] > domain["rollouts"]["hits"]:
        raise InputError(
            f"{source}.training.sequence: {domain['training']['sequence']} is more than "
            f"rollouts.hits = {domain['rollouts']['hits']}; lower it"
        )
