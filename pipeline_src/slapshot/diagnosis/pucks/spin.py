"""What is known of how fast objects spin when they are released: little, or what a simulation says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.launch import LaunchModel
from slapshot.diagnosis.pucks.slide_model import Column, Values

SPIN = 4  # place of the spin in a launch
UNKNOWN_SD = 3.0  # rad/s: what oblique hits give
SIMULATED_SD = 0.6  # rad/s: three times by which a simulation of the hit errs


class SpinPrior(Protocol):
    """Gaussian prior of the spin of n hits."""

    @property
    def sd(self) -> float:
        """Rad/s."""

    def means(self, effects: Mapping[str, Values]) -> Array:
        """(n,) rad/s under effects."""

    def slopes(self, columns: Sequence[Column], effects: Mapping[str, Values]) -> Array:
        """(n, p) of the means by columns."""


@dataclass(frozen=True)
class UnknownSpin:
    """Of n hits whose commands are not known."""

    count: int
    sd: float = UNKNOWN_SD

    def means(self, effects: Mapping[str, Values]) -> Array:
        """Zero: to the left as often as to the right."""
        return np.zeros(self.count)

    def slopes(self, columns: Sequence[Column], effects: Mapping[str, Values]) -> Array:
        """Zero."""
        return np.zeros((self.count, len(columns)))


@dataclass(frozen=True)
class SimulatedSpin:
    """Of hits whose launches are simulated."""

    launches: LaunchModel
    sd: float = SIMULATED_SD

    def means(self, effects: Mapping[str, Values]) -> Array:
        """As simulated."""
        return self.launches.means(effects)[:, SPIN]

    def slopes(self, columns: Sequence[Column], effects: Mapping[str, Values]) -> Array:
        """By what acts on launches."""
        return self.launches.slopes(columns, effects)[:, SPIN]
