"""What encoders say beyond the nominal swing, and how it changes with effects of swing and contact."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.launch.execution import Execution
from slapshot.diagnosis.pucks.slide.slide_model import Column, Values


@dataclass(frozen=True)
class Encoders:
    """What encoders say of n hits beyond the nominal swing.

    Attributes:
        execution: with the residuals of the encoders.
        white: (n, rows) of those residuals.
        changes: effect/parameter -> (v, n, rows) of the changes at the signature's values.
    """

    execution: Execution
    white: Array
    changes: Mapping[str, PchipInterpolator]

    @property
    def readings(self) -> int:
        """Readings of one hit: what is whitened has more rows, since its part within a basis comes twice."""
        return self.execution.residual[0].size

    def rows(
        self,
        columns: Sequence[Column],
        effects: Mapping[str, Values],
        neutral: Mapping[str, Values],
    ) -> tuple[Array, Array]:
        """Whitened residuals (n, rows) under effects and their derivatives (n, rows, p)."""
        left = self.white.copy()
        for name, value in each(effects):
            if name in self.changes:
                left -= value_at(self.changes[name], value)
        slopes = np.zeros((*left.shape, len(columns)), np.float32)
        for c, column in enumerate(columns):
            change = self.changes.get(f"{column.owner}/{column.parameter}")
            if change is not None:
                here = effects.get(column.owner, neutral[column.owner])[column.parameter]
                slopes[..., c] = (value_at(change, here + column.step) - value_at(change, here)) / column.step
        return left, slopes


def each(effects: Mapping[str, Values]) -> Iterator[tuple[str, float]]:
    """effect/parameter and value."""
    for owner, values in effects.items():
        for parameter, value in values.items():
            yield f"{owner}/{parameter}", value


def value_at(change: PchipInterpolator, value: float) -> Array:
    """A change at a value; beyond what was simulated it goes on straight."""
    inside = float(np.clip(value, change.x[0], change.x[-1]))
    found = np.asarray(change(inside), float)
    return found if inside == value else found + (value - inside) * np.asarray(change(inside, 1), float)
