"""YAML files: mappings of a sane size, or one line that says what is wrong where."""

from pathlib import Path
from typing import Any

import yaml

from slapshot.errors import InputError

_DEEPEST, _LARGEST = 50, 100_000  # levels and values of a configuration, far beyond any use


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML file that holds a mapping."""
    try:
        value = yaml.load(path.read_text("utf-8"), _Loader)
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; give the path of a configuration, for example config/tiny.yaml"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of a file") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = getattr(error, "problem_mark", None)
        line, place = (f" line {where.line + 1}:", "that line") if where is not None else ("", "it")
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InputError(f"{path}:{line} not valid YAML ({problem}); mend {place}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid YAML (brackets in brackets without end); mend it") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: holds no keys; a configuration is a mapping of keys to values")
    _check_size(value, path)
    return value


class _Loader(yaml.SafeLoader):
    """The safe loader, which also names the line of a date or number that cannot be."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, KeyError, AttributeError):
            problem = f"{str(node.value)[:40]!r} is no {node.tag.rpartition(':')[2]}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None


def _check_size(value: Any, path: Path) -> None:
    """Refuse aliases (*name) that hold themselves, or each other so often that checking would not end."""
    waiting, count = [(value, 0)], 0
    while waiting:
        item, depth = waiting.pop()
        count += 1
        if depth > _DEEPEST or count > _LARGEST:
            raise InputError(f"{path}: holds too many values in each other; remove an alias (*name)")
        inside = item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
        waiting += [(part, depth + 1) for part in inside]
