"""Uneven board: hills and hollows."""

from collections.abc import Mapping, Sequence

import numpy as np

from slapshot.arrays import GRAVITY, Array
from slapshot.effects.bases import BOARD
from slapshot.effects.effect import Effect, Parameter, SlideState

_NAMES = tuple(f"height_{j}" for j in range(len(BOARD)))


class UnevenBoard(Effect):
    name = "uneven_board"
    phase = "slide"
    follows = "place"
    parameters = tuple(Parameter(name, "m", -0.05, 0.05, 0.004, "height of one bump") for name in _NAMES)
    physics = (
        "Gravity along a smooth surface, a = -g grad h(x, y): a push that depends on the place alone and\n"
        "has no curl. Heights are those of Gaussian bumps on a grid, up to a constant."
    )
    source = "Goldstein, Classical Mechanics, section 1.4 (motion on a surface, small slopes)"
    known_to = 0.08  # a grid of bumps

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Down the slope of all bumps together."""
        heights = np.array([values[name] for name in _NAMES])
        along_x, along_y = BOARD.slope(heights, state.x, state.y)
        return -GRAVITY * along_x, -GRAVITY * along_y

    def push_shapes(self, parameters: Sequence[str], state: SlideState) -> tuple[Array, Array]:
        """Down the slopes of some bumps."""
        along_x, along_y = BOARD.slopes([_NAMES.index(name) for name in parameters], state.x, state.y)
        return -GRAVITY * along_x, -GRAVITY * along_y

    def reaches(self, parameter: str, places: Array) -> bool:
        """Bumps reach as far as they are wide."""
        return BOARD.near(_NAMES.index(parameter), places)
