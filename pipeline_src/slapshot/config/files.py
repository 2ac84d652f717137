"""Configurations as files: read, laid over each other and checked."""

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
    """A configuration that may be as it is, and the files that it comes from.

    Attributes:
        settings: what it says.
        layers: where each of its values stands.
    """

    settings: Configuration
    layers: Layers


def load_config(path: Path | None = None) -> Configuration:
    """Default configuration with the values of `path` laid over it.

    Args:
        path: a YAML file with the keys that differ from the default; None for the default itself.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed.
    """
    return read_config([] if path is None else [path]).settings


def read_config(files: Sequence[Path], arguments: Mapping[str, Any] | None = None) -> Checked:
    """Default configuration with files and arguments laid over it.

    Args:
        files: YAML, with the keys that differ; the last one counts most.
        arguments: of the command line, which count more than any file.

    Raises:
        InputError: a file is missing or not YAML, or a value is not allowed: where it stands, the key, what
            is wrong with it and what would be right.
    """
    if not DEFAULT_CONFIG.is_file():
        raise InputError(f"{DEFAULT_CONFIG}: no such file; run this in the top folder of the repository")
    others = [file for file in files if file.resolve() != DEFAULT_CONFIG.resolve()]
    layers = Layers.read([DEFAULT_CONFIG, *others], arguments or {})
    return Checked(validated(Configuration, layers.values, layers.where), layers)
