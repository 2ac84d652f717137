"""Numbers in the settings: a fixed value, or a range [low, high] from which a value is drawn uniformly."""

from collections.abc import Sequence

import numpy as np


def draw_number(value: float | Sequence[float], rng: np.random.Generator) -> float:
    """The fixed number, or one drawn uniformly from the range."""
    if isinstance(value, int | float):
        return float(value)
    return float(rng.uniform(*pair_of(value)))


def pair_of(value: Sequence[float]) -> tuple[float, float]:
    """Low and high."""
    low, high = value
    return float(low), float(high)
