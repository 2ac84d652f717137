"""Conditions: draws of the randomised parameters (paper, tables I and II), from the configuration."""

import numpy as np
from numpy.typing import NDArray

from slapshot.config.randomisation import CONDITION_PARAMETERS, Draw, Draws


def draw_conditions(
    randomisation: Draws, count: int, rng: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Parameter -> (count,) values.

    Args:
        randomisation: what each parameter is drawn from; friction_y as a multiple of friction_x, say.
        count: how many conditions.
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
    """(count, 2) displacements in m of the object from where it was meant to lie.

    Drawn anew for every hit: where the object really lies is never quite where it was meant to lie.
    """
    return np.stack([_draw(start_error, count, rng), _draw(start_error, count, rng)], axis=1)


def middle_condition(randomisation: Draws) -> dict[str, float]:
    """The mean of every parameter: what a named condition leaves unsaid."""
    values: dict[str, float] = {}
    for name in CONDITION_PARAMETERS:
        draw = randomisation.of_parameter(name)
        mean = draw.numbers[0] if draw.uniform is None else float(np.mean(draw.uniform))
        values[name] = mean if draw.times is None else mean * values[draw.times]
    return values


def _draw(draw: Draw, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    law = rng.normal if draw.uniform is None else rng.uniform
    return law(*draw.numbers, count)
