"""Numbers in the settings: one, which is taken as it is, or [low, high], drawn uniformly in between."""

import numpy as np

from slapshot.errors import InputError


def draw_number(value: float | list[float], key: str, rng: np.random.Generator) -> float:
    """The number, or one from the range; `key` is where it stands below `lab`."""
    if isinstance(value, int | float):
        return float(value)
    return float(rng.uniform(*pair_of(value, key)))


def pair_of(value: list[float], key: str) -> tuple[float, float]:
    """Low and high.

    Raises:
        InputError: they are the wrong way round.
    """
    low, high = value
    if low > high:
        raise InputError(f"lab.{key}: {value} runs backwards; write [low, high] with low <= high")
    return float(low), float(high)
