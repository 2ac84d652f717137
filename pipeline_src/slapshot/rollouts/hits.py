"""Hits to simulate and their outcomes: input and output of every domain's collector."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array


@dataclass(frozen=True)
class Hits:
    """n hits to simulate.

    Attributes:
        swings: (n,) rows of the pool of swings.
        conditions: parameter -> (n,) values, see scenes.randomisation.
        start_errors: (n, 2) m, displacement of the object from its nominal start.
    """

    swings: NDArray[np.int64]
    conditions: dict[str, Array]
    start_errors: Array

    def rows(self, rows: slice | NDArray[np.int64]) -> "Hits":
        """Some of the hits."""
        conditions = {name: values[rows] for name, values in self.conditions.items()}
        return Hits(self.swings[rows], conditions, self.start_errors[rows])


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of n hits.

    Attributes:
        launch_times: (n,) s from the swing's start to the launch, when the object is free of the striker.
        launches: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) at the launch.
        rests: (n, 3) x, y (m), yaw (rad) at rest.
        durations: (n,) s from the launch to rest.
    """

    launch_times: Array
    launches: Array
    rests: Array
    durations: Array

    @classmethod
    def joined(cls, parts: "list[Outcomes]") -> "Outcomes":
        """Concatenate the outcomes of all parts in order."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])))


class HitCollector(Protocol):
    """Interface of the part `collector` of a domain, its class Collector(scene, swings, threads)."""

    def collect(self, hits: Hits) -> Outcomes:
        """Simulate any number of hits; the outcome of a hit does not depend on the others."""

    def collect_with_tracks(self, hits: Hits, period: float) -> tuple[Outcomes, list[Array]]:
        """The same, and for each hit a track (rows, 4): t, x, y, yaw every `period` s to rest."""
