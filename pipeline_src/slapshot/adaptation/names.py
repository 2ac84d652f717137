"""Names of adaptation methods; apart from `method.py`, so that the plan need not import torch."""

from collections.abc import Mapping
from typing import Any


def method_file(name: str) -> str:
    """Return the file of this package, without .py, that a method's name in the configuration means.

    One file can serve several methods that differ in their settings: what follows the first
    underscore tells them apart (`maml_1` and `maml_8` are both maml.py).
    """
    return name.partition("_")[0]


def method_settings(configured: Mapping[str, Any]) -> dict[str, Any]:
    """A method's own settings: what stands in its section of the configuration, without the training's."""
    return {key: value for key, value in configured.items() if key != "learning_rate"}
