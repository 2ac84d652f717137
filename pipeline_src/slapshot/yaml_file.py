"""YAML files: mappings of limited size without repeated keys, with one-line error messages."""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from slapshot.errors import InputError, reading

_DEEPEST, _LARGEST = 50, 100_000  # nesting depth and number of values, far more than needed
_LONGEST = 4_000_000  # bytes of a file, far more than needed

Loc = tuple[str | int, ...]


@dataclass(frozen=True)
class Document:
    """A YAML file and the lines of its values.

    Attributes:
        path: of the file.
        values: the mapping that it holds.
        lines: location of a value (its keys and list indices, outermost first) -> line, from 1.
    """

    path: Path
    values: dict[str, Any]
    lines: Mapping[Loc, int] = field(default_factory=dict)

    def where(self, loc: Loc) -> str:
        """File and line of a value; if the value is missing, those of the mapping or list that holds it."""
        for end in range(len(loc), 0, -1):
            if loc[:end] in self.lines:
                return f"{self.path}:{self.lines[loc[:end]]}"
        return str(self.path)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping.

    Raises:
        InputError: it cannot be read, is not YAML, repeats a key or holds no mapping.
    """
    return read_document(path).values


def read_document(path: Path) -> Document:
    """As `read_yaml`, with the line of every value."""
    with reading(path, "give the path of a YAML file, for example config/tiny.yaml", _LONGEST):
        text = path.read_bytes()
    try:
        node = yaml.compose(text.decode("utf-8-sig"), _Loader)
        lines = _lines(node)
        value = _construct(node)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = getattr(error, "problem_mark", None)
        line, place = (f":{where.line + 1}:", "that line") if where is not None else (":", "it")
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InputError(f"{path}{line} not valid YAML ({problem}); mend {place}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid YAML (brackets in brackets without end); mend it") from None
    except _TooLargeError:
        raise InputError(f"{path}: holds too many values in each other; remove an alias (*name)") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: holds no keys; it must be a mapping of keys to values")
    return Document(path, value, lines)


class _TooLargeError(Exception):
    """Aliases (*name) that are recursive, or that expand to too many values."""


class _Loader(yaml.SafeLoader):
    """Safe loader that refuses repeated keys and reports the line of an invalid value."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, KeyError, AttributeError, OverflowError):
            problem = f"{str(node.value)[:40]!r} is no {node.tag.rpartition(':')[2]}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue  # keys merged by `<<: *name` may be overridden
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable):
                if key in seen:
                    problem = f"key {str(key)[:40]!r} stands there twice"
                    raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
                seen.add(key)
        return super().construct_mapping(node, deep)


def _construct(node: yaml.Node | None) -> Any:
    if node is None:
        return None
    loader = _Loader("")
    try:
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _lines(root: yaml.Node | None) -> dict[Loc, int]:
    """Line of every value; documents that are too deep or too large are refused before construction."""
    found: dict[Loc, int] = {}
    waiting: list[tuple[yaml.Node, Loc]] = [(root, ())] if root is not None else []
    count = 0
    while waiting:
        node, loc = waiting.pop()
        count += 1
        if len(loc) > _DEEPEST or count > _LARGEST:
            raise _TooLargeError
        found.setdefault(loc, node.start_mark.line + 1)
        waiting += _inside(node, loc, found)
    return found


def _inside(node: yaml.Node, loc: Loc, found: dict[Loc, int]) -> Iterator[tuple[yaml.Node, Loc]]:
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            yield item, (*loc, i)
    elif isinstance(node, yaml.MappingNode):
        for key, item in node.value:
            inner = (*loc, str(key.value) if isinstance(key, yaml.ScalarNode) else "?")
            found.setdefault(inner, key.start_mark.line + 1)
            yield item, inner
