"""Place friction: the board is slippery here and rough there."""

from collections.abc import Mapping, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.bases import BOARD
from slapshot.effects.effect import Effect, Parameter, SlideState

_NAMES = tuple(f"log_friction_{j}" for j in range(len(BOARD)))


class PlaceFriction(Effect):
    name = "place_friction"
    phase = "slide"
    follows = "place"
    parameters = tuple(Parameter(name, "1", -2.0, 2.0, 0.1, "log friction of one bump") for name in _NAMES)
    physics = (
        "Coulomb friction whose coefficient depends on the place (wear, dirt, another material): mu(x, y).\n"
        "It slows along the motion and never pushes; logarithms are those of Gaussian bumps on a grid."
    )
    source = "Yu, Bauza, Fazeli and Rodriguez 2016, More than a million ways to be pushed (IROS)"
    known_to = 0.08  # a grid of bumps

    def log_friction(self, values: Mapping[str, Array], state: SlideState) -> Array:
        """Of all bumps together."""
        return BOARD.total(np.array([values[name] for name in _NAMES]), state.x, state.y)

    def log_friction_shapes(self, parameters: Sequence[str], state: SlideState) -> Array:
        """Of some bumps."""
        return BOARD.shapes([_NAMES.index(name) for name in parameters], state.x, state.y)

    def reaches(self, parameter: str, places: Array) -> bool:
        """Bumps reach as far as they are wide."""
        return BOARD.near(_NAMES.index(parameter), places)
