"""Curl: a spinning object bends its path."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class Curl(Effect):
    name = "curl"
    phase = "slide"
    follows = "spin"
    parameters = (
        Parameter("strength", "1", -5.0, 5.0, 0.3, "bends to the left of its motion where spin is positive"),
    )
    physics = (
        "A force across the motion in proportion to spin and speed, a = strength spin z x v: air (Magnus)\n"
        "or friction that is larger under the leading edge than under the trailing one (curling stones)."
    )
    source = "Nyberg, Alfredson, Hogmark and Jacobson 2013, Wear 301, The asymmetrical friction mechanism"

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Across the velocity."""
        turn = values["strength"] * state.spin
        return -turn * state.vy, turn * state.vx
