"""Conditions: draws of the randomised parameters (paper, tables I and II), from the configuration."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Parameters that every scene understands, in SI units: kg, 1, 1, m, m.
CONDITION_PARAMETERS = (
    "mass",
    "friction_x",
    "friction_y",
    "friction_torsional",
    "friction_rolling",
)
# Drawn anew for every hit: where the object really lies is never quite where it was meant to lie.
START_ERROR = "start_error"


def draw_conditions(
    randomisation: Mapping[str, Mapping[str, Any]], count: int, rng: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Parameter -> (count,) values.

    Args:
        randomisation: parameter -> {uniform: [low, high]} or {normal: [mean, sd]}, with `times` naming
            another parameter that scales the draw (friction_y is drawn as a multiple of friction_x).
        count: how many conditions.
        rng: source of randomness.
    """
    values: dict[str, NDArray[np.float64]] = {}
    for name in CONDITION_PARAMETERS:
        values[name] = _draw(randomisation[name], count, rng)
        factor = randomisation[name].get("times")
        if factor is not None:
            values[name] = values[name] * values[factor]
    return values


def draw_start_errors(
    randomisation: Mapping[str, Mapping[str, Any]], count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(count, 2) displacements in m of the object from where it was meant to lie."""
    spec = randomisation[START_ERROR]
    return np.stack([_draw(spec, count, rng), _draw(spec, count, rng)], axis=1)


def middle_condition(randomisation: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """The mean of every parameter: what a named condition leaves unsaid."""
    values: dict[str, float] = {}
    for name in CONDITION_PARAMETERS:
        spec = randomisation[name]
        mean = float(np.mean(spec["uniform"])) if "uniform" in spec else float(spec["normal"][0])
        factor = spec.get("times")
        values[name] = mean * values[factor] if factor is not None else mean
    return values


def _draw(spec: Mapping[str, Any], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    draw, (first, second) = (
        (rng.uniform, spec["uniform"]) if "uniform" in spec else (rng.normal, spec["normal"])
    )
    return draw(first, second, count)
