"""The ensemble that acts: one with beliefs, whose weights stay as they are."""

from pathlib import Path

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.kalman import Kalman
from slapshot.errors import InputError


def load_believing(folder: Path) -> tuple[Kalman, Standardiser]:
    """Read a version of the stage `train`.

    Raises:
        InputError: its method has no belief that uncertainty could be taken from.
    """
    method, standardiser = load_ensemble(folder)
    if not isinstance(method, Kalman):
        raise InputError(f"acting.method: {type(method).__name__} has no belief to act on; use kalman")
    return method.requires_grad_(False), standardiser
