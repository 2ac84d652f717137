"""Tilt: the board is not level."""

from collections.abc import Mapping

from slapshot.arrays import GRAVITY, Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class Tilt(Effect):
    name = "tilt"
    phase = "slide"
    follows = "heading"
    parameters = (
        Parameter("slope_x", "m/m", -0.1, 0.1, 0.01, "rise towards +x"),
        Parameter("slope_y", "m/m", -0.1, 0.1, 0.01, "rise towards +y"),
    )
    physics = (
        "Gravity along an inclined plane, a = -g grad h: the same push everywhere, whatever the speed.\n"
        "Hits one way end short, hits the other way go too far, and sideways ones bend."
    )
    source = "Any mechanics text; e.g. Kleppner and Kolenkow, An Introduction to Mechanics, section 2.4"

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """The same at every place."""
        return -GRAVITY * values["slope_x"], -GRAVITY * values["slope_y"]
