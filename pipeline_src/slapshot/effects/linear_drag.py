"""Linear drag: resistance in proportion to speed."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class LinearDrag(Effect):
    name = "linear_drag"
    phase = "slide"
    follows = "speed"
    parameters = (Parameter("rate", "1/s", 0.0, 5.0, 0.3, "deceleration over speed"),)
    physics = (
        "A viscous film (water, oil, an air cushion) shears under the object: a = -rate v.\n"
        "Fast hits end shorter than dry friction alone explains."
    )
    source = "Stokes drag and Couette flow; Batchelor, An Introduction to Fluid Dynamics, section 4.8"

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Against the velocity."""
        return -values["rate"] * state.vx, -values["rate"] * state.vy
