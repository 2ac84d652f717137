"""Restitution: the object rebounds more or less than believed."""

from collections.abc import Mapping

import mujoco
import numpy as np

from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo
from slapshot.scenes.striker import striker_pair


class Restitution(Effect):
    name = "restitution"
    phase = "contact"
    follows = "speed"
    parameters = (
        Parameter("log_damping", "1", -2.0, 2.0, 0.3, "log of true over believed damping of the contact"),
    )
    physics = (
        "Striker and object meet through a spring and a damper, which changes: with damping ratio z an\n"
        "impact returns the share exp(-2 z acos(z) / r) of its speed (r = sqrt(1 - z^2), z < 1)."
    )
    source = "Schwager and Poeschel 2007, Coefficient of restitution and linear-dashpot model revisited"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Change solref: (time constant, damping ratio), or (-stiffness, -damping) where it is negative.

        The stiffness of the former goes with 1 / (time constant * damping ratio)^2, which stays.
        """
        log_damping = values["log_damping"]
        if log_damping == 0:
            return
        factor = np.exp(log_damping)
        pair = striker_pair(spec, info)
        first, second = pair.solref
        pair.solref = (first / factor, second * factor) if first > 0 else (first, second * factor)
