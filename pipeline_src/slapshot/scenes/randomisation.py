"""Domain randomisation: draws of the randomised parameters (paper, tables I and II)."""

import numpy as np
from numpy.typing import NDArray

from slapshot.config.randomisation import CONDITION_PARAMETERS, Draw, Draws


def draw_conditions(
    randomisation: Draws, count: int, rng: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Draw conditions: parameter -> (count,) values.

    Args:
        randomisation: distribution of each parameter; a parameter may be drawn as a multiple of another one,
            such as friction_y of friction_x.
        count: number of conditions.
        rng: source of randomness.
    """
    values: dict[str, NDArray[np.float64]] = {}
    for name in CONDITION_PARAMETERS:
        draw = randomisation.of_parameter(name)
        values[name] = _draw(draw, count, rng)
        if draw.times is not None:
            values[name] = values[name] * values[draw.times]
    return values


def draw_start_errors(start_error: Draw, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw (count, 2) displacements in m of the object from its nominal start.

    They are drawn for every hit, because objects are never placed exactly.
    """
    return np.stack([_draw(start_error, count, rng), _draw(start_error, count, rng)], axis=1)


def middle_condition(randomisation: Draws) -> dict[str, float]:
    """The mean of every parameter, which is the default in named conditions."""
    values: dict[str, float] = {}
    for name in CONDITION_PARAMETERS:
        draw = randomisation.of_parameter(name)
        mean = draw.numbers[0] if draw.uniform is None else float(np.mean(draw.uniform))
        values[name] = mean if draw.times is None else mean * values[draw.times]
    return values


def _draw(draw: Draw, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    law = rng.normal if draw.uniform is None else rng.uniform
    return law(*draw.numbers, count)
