"""Curl: a spinning object bends its path."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class Curl(Effect):
    name = "curl"
    phase = "slide"
    follows = "spin"
    parameters = (
        Parameter("strength", "1", -5.0, 5.0, 0.3, "bends to the left of its motion where spin is positive"),
        Parameter(
            "log_spin", "log rad/s", -2.0, 4.0, 1.0, "logarithm of the spin at which it levels off", 1.0
        ),
    )
    physics = (
        "A force across the motion, a = strength spin z x v / sqrt(1 + (spin / w_s)^2): air (Magnus) or\n"
        "more friction under the leading edge. It levels off: curling stones bend hardly more at more spin."
    )
    source = (
        "Nyberg, Alfredson, Hogmark and Jacobson 2013, Wear 301, The asymmetrical friction mechanism; "
        "Jensen and Shegelski 2004, Canadian Journal of Physics 82(10) (hardly more with spin)"
    )

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Across the velocity."""
        turn = values["strength"] * state.spin / np.hypot(1.0, state.spin / np.exp(values["log_spin"]))
        return -turn * state.vy, turn * state.vx
