"""`python -m slapshot.keys_table MODULE MODEL`: keys of a file that a pydantic model reads, for people."""

import importlib
import re
import sys
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

_HEADER = "| key | what it says | left out |\n| --- | --- | --- |\n"


def keys_table(model: type[BaseModel]) -> str:
    """One row a key in Markdown, in the order of a model and those within it."""
    keys = _keys(model, "")
    return _HEADER + "".join(f"| `{key}` | {_meaning(field)} | {_default(field)} |\n" for key, field in keys)


def _keys(model: type[BaseModel], before: str) -> Iterator[tuple[str, FieldInfo]]:
    for name, field in model.model_fields.items():
        inner = [part for part in _parts(field.annotation) if _is_model(part)]
        named = any(get_origin(part) is dict for part in _parts(field.annotation))
        key = f"{before}{name}.NAME" if named else f"{before}{name}"
        if not inner or named:
            yield key, field
        for part in inner:
            yield from _keys(part, f"{key}.")


def _parts(annotation: Any) -> list[Any]:
    """An annotation and all that it is composed of."""
    if get_origin(annotation) in (Annotated, Union, types.UnionType, dict):
        inner = [part for argument in get_args(annotation) for part in _parts(argument)]
        return [annotation, *inner] if get_origin(annotation) is dict else inner
    return [annotation]


def _is_model(part: Any) -> bool:
    return isinstance(part, type) and issubclass(part, BaseModel)


def _meaning(field: FieldInfo) -> str:
    said = re.sub(r"([*<>|])", r"\\\1", field.description or "")
    literals = [part for part in _parts(field.annotation) if get_origin(part) is Literal]
    choices = ", ".join(f"`{choice}`" for part in literals for choice in get_args(part))
    return f"{said} ({choices})" if said and choices else said or choices


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "not possible"
    value = field.get_default(call_default_factory=True)
    shown = str(value).lower() if isinstance(value, bool) else value
    return "" if value in (None, (), "", {}) else f"`{shown}`"


if __name__ == "__main__":
    module, name = sys.argv[1:]
    print(keys_table(getattr(importlib.import_module(module), name)), end="")
