"""Lens distortion: straight lines are bent in the recording."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter


class LensDistortion(Effect):
    name = "lens_distortion"
    phase = "camera"
    follows = "place"
    parameters = (
        Parameter("radial", "1/m^2", -0.1, 0.1, 0.008, "places far from the middle are reported farther"),
        Parameter("middle_x", "m", -0.5, 0.5, 0.1, "of the lens, from the point it looks at, along x"),
        Parameter("middle_y", "m", -0.5, 0.5, 0.1, "of the lens, from the point it looks at, along y"),
    )
    physics = (
        "The first radial term of a lens that was not calibrated: r -> r (1 + radial r^2) about the middle.\n"
        "Scale depends on the place, so that speeds seem to change along a path."
    )
    source = "Brown 1966, Decentering distortion of lenses, Photogrammetric Engineering 32(3)"
    known_to = 0.0

    def see(self, values: Mapping[str, Array], places: Array, camera: Array) -> Array:
        """Along the radius from the middle."""
        middle = np.stack([values["middle_x"], values["middle_y"]], axis=-1)[:, None]
        offset = places - camera - middle
        square = (offset**2).sum(-1, keepdims=True)
        return places + values["radial"][:, None, None] * square * offset
