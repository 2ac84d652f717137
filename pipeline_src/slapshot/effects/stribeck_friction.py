"""Stribeck friction: more of it at low speed."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class StribeckFriction(Effect):
    name = "stribeck_friction"
    phase = "slide"
    follows = "speed"
    parameters = (
        Parameter("rise", "1", -0.8, 4.0, 0.3, "share by which friction at rest exceeds that at speed"),
        Parameter("log_speed", "log m/s", -3.0, 0.7, 0.6, "logarithm of the speed at which it fades", -0.9),
    )
    physics = (
        "Coulomb friction rises as speed falls, mu (1 + rise exp(-(v / v_s)^2)): asperities bond longer.\n"
        "Slow hits, and the end of all hits, stop sooner than the start of fast ones tells."
    )
    source = "Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), equation 8"

    def log_friction(self, values: Mapping[str, Array], state: SlideState) -> Array:
        """By the speed of the centre."""
        share = np.exp(-((state.speed / np.exp(values["log_speed"])) ** 2))
        return np.log1p(values["rise"] * share)
