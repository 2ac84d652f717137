"""Quadratic drag: resistance in proportion to the square of speed."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class QuadraticDrag(Effect):
    name = "quadratic_drag"
    phase = "slide"
    follows = "speed"
    parameters = (Parameter("per_length", "1/m", 0.0, 3.0, 0.2, "deceleration over speed squared"),)
    physics = (
        "Air at high Reynolds number: a = -per_length |v| v, with per_length = rho c A / (2 m).\n"
        "Like linear drag, but concentrated at the start of fast hits."
    )
    source = "Batchelor, An Introduction to Fluid Dynamics, section 5.11"

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Against the velocity."""
        factor = -values["per_length"] * state.speed
        return factor * state.vx, factor * state.vy
