"""Air that moves."""

from collections.abc import Iterator, Sequence

import numpy as np

from slapshot.effects.joints.effect import Array, JointEffect, Parameter, Situation, State
from slapshot.effects.joints.parts import weight


class Wind(JointEffect):
    name = "wind"
    physics = "A steady wind pushes a body with a constant force."
    source = "Batchelor, An Introduction to Fluid Dynamics (1967), section 5.11"
    phrase = "wind on {part}"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["Wind"]:
        """One a free body; prior: a tenth of its weight, level."""
        for body, v in rig.free_bodies:
            scale = 0.1 * weight(rig.model, body)
            axes = [Parameter(f"force_{axis}", "N", scale, probe=0.01 * scale) for axis in "xy"]
            yield cls(rig.model.body(body).name, v, axes)

    def __init__(self, part: str, v: int, parameters: Sequence[Parameter]) -> None:
        super().__init__(part, parameters)
        self._v = v

    def force(self, state: State, values: Array) -> Array:
        """Constant and level."""
        force = np.zeros_like(state.v)
        force[:, self._v : self._v + 2] = values
        return force
