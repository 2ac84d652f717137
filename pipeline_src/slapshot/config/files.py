"""Reads configuration files, merges and validates them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slapshot.config.configuration import Configuration
from slapshot.config.layers import Layers
from slapshot.errors import InputError
from slapshot.validation import validated

DEFAULT_CONFIG = Path("config/default.yaml")


@dataclass(frozen=True)
class Checked:
    """A validated configuration and the files that it comes from.

    Attributes:
        settings: the configuration.
        layers: the merged files, which locate each value.
    """

    settings: Configuration
    layers: Layers


def load_config(path: Path | None = None) -> Configuration:
    """Read the default configuration, overridden by the values in `path`.

    Args:
        path: a YAML file with the keys that differ from the default; None for the default itself.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed.
    """
    return read_config([] if path is None else [path]).settings


def read_config(files: Sequence[Path], arguments: Mapping[str, Any] | None = None) -> Checked:
    """Read the default configuration, overridden by files and arguments.

    Args:
        files: YAML files with the keys that differ; the last one has the highest precedence.
        arguments: of the command line, which override all files.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed; the message gives the value's
            location, the key, the problem and the remedy.
    """
    if not DEFAULT_CONFIG.is_file():
        raise InputError(f"{DEFAULT_CONFIG}: no such file; run this in the top folder of the repository")
    others = [file for file in files if file.resolve() != DEFAULT_CONFIG.resolve()]
    layers = Layers.read([DEFAULT_CONFIG, *others], arguments or {})
    return Checked(validated(Configuration, layers.values, layers.where), layers)
