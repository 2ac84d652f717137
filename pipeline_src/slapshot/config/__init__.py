"""The configuration: config/default.yaml, files laid over it, and the models that say what may stand in them.

What a key means and which values it takes stands in one model a block: `configuration` (the whole), `domain`,
`scene`, `recordings`, `lab`, `methods`, `acting`, `regression`; `values` has what they share.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slapshot.config.configuration import Configuration
from slapshot.config.layers import Layers, merge
from slapshot.errors import InputError
from slapshot.validation import validated
from slapshot.yaml_file import Loc

__all__ = ["DEFAULT_CONFIG", "Configuration", "Layers", "check_config", "load_config", "merge", "read_config"]

DEFAULT_CONFIG = Path("config/default.yaml")


def load_config(path: Path | None = None) -> dict[str, Any]:
    """Default configuration with the values of `path` laid over it, checked.

    Args:
        path: a YAML file with the keys that differ from the default; None for the default itself.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed.
    """
    return read_config([] if path is None else [path]).values


def read_config(files: Sequence[Path], arguments: Mapping[str, Any] | None = None) -> Layers:
    """Default configuration with files and arguments laid over it, checked.

    Args:
        files: YAML, with the keys that differ; the last one counts most.
        arguments: of the command line, which count more than any file.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed.
    """
    if not DEFAULT_CONFIG.is_file():
        raise InputError(f"{DEFAULT_CONFIG}: no such file; run this in the top folder of the repository")
    others = [file for file in files if file.resolve() != DEFAULT_CONFIG.resolve()]
    layers = Layers.read([DEFAULT_CONFIG, *others], arguments or {})
    check_config(layers.values, layers.where)
    return layers


def check_config(config: Mapping[str, Any], where: Callable[[Loc], str] | str) -> Configuration:
    """The models of a configuration's values.

    Args:
        config: all of them.
        where: file and line of a value, or the file.

    Raises:
        InputError: naming where it stands, the key, what is wrong with it and what would be right.
    """
    return validated(Configuration, config, where)
