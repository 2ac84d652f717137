"""Turned anisotropy: the directions of least and most friction are not the board's axes."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter


class TurnedAnisotropy(Effect):
    name = "turned_anisotropy"
    phase = "slide"
    follows = "heading"
    parameters = (
        Parameter("cross", "1", -1.0, 1.0, 0.1, "log friction is larger along x = y than across it"),
    )
    physics = (
        "Friction as a tensor mu = exp(S) with symmetric S; the nominal scene has only its diagonal, mu_x\n"
        "and mu_y. With a cross term hits bend towards the slippery direction, which lies askew."
    )
    source = "Goyal, Ruina and Papadopoulos 1991, Wear 143, section 2 (anisotropic limit surfaces)"

    def cross_anisotropy(self, values: Mapping[str, Array]) -> Array:
        """Off-diagonal of S."""
        return values["cross"]
