"""Swings: sampled latents, each decoded, checked and executed once without an object."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load_file, save_file

from slapshot.arrays import Array

SPLITS = ("train", "validation", "test")
POSE_PERIOD = 0.02  # s between the robot's poses that are kept for visualisation


@dataclass(frozen=True)
class Swings:
    """Swings of the robot alone.

    Dimensions: n swings, w ticks in the window, t ticks in all, j joints, c numbers in a command.

    Attributes:
        latents: (n, latent) actions.
        splits: (n,) index into SPLITS.
        starts: (n, 2) m, nominal start of the object.
        targets: (n, t, c) commands, one per control period; for an arm with servos, their targets in rad.
        positions, velocities: (n, w, j) of the joints in rad and rad/s within the window.
        first: (n,) tick at which a swing's window begins.
        striker: (n, t, 3) position in m of the striker's site.
        normal: (n, t, 3) unit normal of its striking face.
        poses: (n, p, j) joint positions in rad at `pose_times`.
    """

    latents: Array
    splits: NDArray[np.int64]
    starts: Array
    targets: Array
    positions: Array
    velocities: Array
    first: NDArray[np.int64]
    striker: Array
    normal: Array
    poses: Array

    def of_split(self, split: str) -> NDArray[np.int64]:
        """Indices of the swings of a split."""
        return np.flatnonzero(self.splits == SPLITS.index(split))

    def of(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "Swings":
        """Select some of the swings."""
        return Swings(**{name: value[rows] for name, value in vars(self).items()})

    def pose_times(self, control_period: float) -> Array:
        """(p,) s from the swing's start."""
        ticks = np.arange(self.poses.shape[1], dtype=np.float64) * pose_stride(control_period)
        return ticks * control_period

    def save(self, folder: Path) -> None:
        """Write swings.safetensors."""
        arrays = {name: np.ascontiguousarray(value) for name, value in vars(self).items()}
        save_file(arrays, folder / "swings.safetensors")

    @classmethod
    def load(cls, folder: Path) -> "Swings":
        """Read what `save` wrote."""
        return cls(**load_file(folder / "swings.safetensors"))


def pose_stride(control_period: float) -> int:
    """Ticks between poses that are kept."""
    return max(1, round(POSE_PERIOD / control_period))
