"""Trained ensembles for goal reaching, with fixed weights."""

from pathlib import Path
from typing import Any

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.kalman import Kalman
from slapshot.adaptation.method import AdaptationMethod
from slapshot.errors import InputError


def load_acting(folder: Path) -> tuple[AdaptationMethod[Any], Standardiser]:
    """Read a version of the stage `train`."""
    method, standardiser = load_ensemble(folder)
    return method.requires_grad_(False), standardiser


def load_believing(folder: Path) -> tuple[Kalman, Standardiser]:
    """As `load_acting`, for a method with Gaussian beliefs.

    Raises:
        InputError: the method has no belief from which to compute uncertainty.
    """
    method, standardiser = load_acting(folder)
    if not isinstance(method, Kalman):
        raise InputError(f"acting.method: {type(method).__name__} has no belief to act on; use kalman")
    return method, standardiser
