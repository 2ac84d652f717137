"""Blade friction: the striker grips the object more or less than believed."""

from collections.abc import Mapping

import mujoco
import numpy as np

from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo
from slapshot.scenes.striker import striker_pair


class BladeFriction(Effect):
    name = "blade_friction"
    phase = "contact"
    follows = "spin"
    parameters = (Parameter("log_factor", "1", -3.0, 2.0, 0.5, "log of true over believed friction"),)
    physics = (
        "Coulomb friction between striking face and object, of tape, wear or moisture.\n"
        "Hits that slide along the face leave more along its motion and spin more; square ones hardly change."
    )
    source = "Cross 2002, Grip-slip behavior of a bouncing ball (American Journal of Physics 70)"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Scale the pair's two coefficients of sliding; those of torsion and rolling stay."""
        log_factor = values["log_factor"]
        if log_factor == 0:
            return
        pair = striker_pair(spec, info)
        friction = np.array(pair.friction)
        friction[:2] *= np.exp(log_factor)
        pair.friction = friction
