"""The hits to simulate: conditions x hits per split, each condition with its own seed."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.config.randomisation import CONDITION_PARAMETERS
from slapshot.config.rollouts import DrawnRollouts
from slapshot.rollouts.hits import Hits
from slapshot.scenes.randomisation import (
    draw_conditions,
    draw_start_errors,
    middle_condition,
)
from slapshot.trajectories.swings import SPLITS, Swings

HITS_PER_SHARD = 4096


@dataclass(frozen=True)
class Shard:
    """A unit of work: consecutive conditions of one split.

    Attributes:
        split: one of SPLITS.
        number: of the shard within its split.
        conditions: rows of the split's conditions.
    """

    split: str
    number: int
    conditions: range

    @property
    def name(self) -> str:
        """File name without suffix."""
        return f"{self.split}-{self.number:06d}"


class RolloutPlan:
    """All conditions and hits of a configuration; they depend on its settings and its seed alone."""

    def __init__(self, settings: DrawnRollouts, swings: Swings) -> None:
        self._settings = settings
        self._swings = swings
        self._randomisation = settings.randomisation
        self.hits = settings.hits
        self._tables = {split: self._conditions(split) for split in SPLITS}

    def conditions(self) -> pd.DataFrame:
        """Table with columns split, condition, name (empty unless a named test condition) and parameters."""
        return pd.concat(
            [table.assign(split=split, condition=range(len(table))) for split, table in self._tables.items()],
            ignore_index=True,
        )[["split", "condition", "name", *CONDITION_PARAMETERS]]

    def shards(self) -> list[Shard]:
        """All shards."""
        size = max(1, HITS_PER_SHARD // self.hits)
        return [
            Shard(split, number, range(begin, min(begin + size, len(table))))
            for split, table in self._tables.items()
            for number, begin in enumerate(range(0, len(table), size))
        ]

    def hits_of(self, shard: Shard) -> tuple[Hits, NDArray[np.bool_]]:
        """The shard's hits, ordered by condition, and a mask of those whose track is kept."""
        pool = self._swings.of_split(shard.split)
        parts = [self._draw(shard.split, condition, pool) for condition in shard.conditions]
        table = self._tables[shard.split].iloc[list(shard.conditions)]
        values = {name: np.repeat(table[name].to_numpy(), self.hits) for name in CONDITION_PARAMETERS}
        hits = Hits(
            swings=np.concatenate([p[0] for p in parts]),
            conditions=values,
            start_errors=np.concatenate([p[1] for p in parts]),
        )
        return hits, np.concatenate([p[2] for p in parts])

    def _draw(self, split: str, condition: int, pool: NDArray[np.int64]):  # type: ignore[no-untyped-def]
        rng = np.random.default_rng([self._settings.seed, SPLITS.index(split), condition, 1])
        swings = rng.choice(pool, self.hits)
        errors = draw_start_errors(self._randomisation.start_error, self.hits, rng)
        return swings, errors, rng.random(self.hits) < self._settings.track_share

    def _conditions(self, split: str) -> pd.DataFrame:
        rng = np.random.default_rng([self._settings.seed, SPLITS.index(split), 0])
        drawn = draw_conditions(self._randomisation, self._settings.count(split), rng)
        table = pd.DataFrame(drawn).assign(name="")
        if split != "test":
            return table
        named = [
            middle_condition(self._randomisation) | condition.given | {"name": name}
            for name, condition in self._settings.named_conditions.items()
        ]
        return pd.concat([table, pd.DataFrame(named)], ignore_index=True)
