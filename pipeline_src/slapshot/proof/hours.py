"""How long the rest of a proof takes, from what its cases took so far."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from slapshot.plan import Plan
from slapshot.store.folder import Store

ASSUMED = 60.0  # s a case of one core, where none is done


def hours_left(store: Store, plan: Plan, stages: Sequence[str], cores: int) -> tuple[int, float]:
    """Cases of a proof that are not diagnosed yet, and hours that they take on so many cores.

    Args:
        store: of the versions.
        plan: whose cases that are made on demand count.
        stages: that record and diagnose a case.
        cores: that work.
    """
    done = {stage: [store.find(stage, i) for i in plan.ids()[stage]] for stage in stages}
    each = [_mean_seconds(versions) for versions in done.values()]
    left = [
        recipe
        for label, recipe in plan.of_stage(stages[-1]).items()
        if label in plan.on_demand and not store.is_whole(recipe.stage, recipe.id)
    ]
    seconds = ASSUMED if None in each else sum(s for s in each if s is not None)
    return len(left), len(left) * seconds / cores / 3600


def _mean_seconds(versions: Iterable[dict[str, Any] | None]) -> float | None:
    seconds = [version["seconds"] for version in versions if version is not None]
    return float(np.mean(seconds)) if seconds else None
