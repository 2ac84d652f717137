"""`python -m slapshot.recordings.importing.keys_table`: keys of a mapping of signals, for people."""

import re
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from slapshot.recordings.importing.signal_mapping import SignalMapping

_HEADER = "| key | what it says | left out |\n| --- | --- | --- |\n"


def as_markdown() -> str:
    """One row a key, in the order of the models that read a mapping."""
    keys = _keys(SignalMapping, "")
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
    return "" if value in (None, (), "") else f"`{shown}`"


if __name__ == "__main__":
    print(as_markdown(), end="")
