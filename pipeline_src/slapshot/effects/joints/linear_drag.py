"""Drag in proportion to the speed of a free body."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion, State
from slapshot.effects.joints.parts import freely, weight


class LinearDrag(JointEffect):
    name = "linear_drag"
    physics = "Slow or small bodies are dragged in proportion to their speed (Stokes)."
    source = "Batchelor, An Introduction to Fluid Dynamics (1967), section 4.9"
    phrase = "linear drag on {part}"
    empirical = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["LinearDrag"]:
        """One for each free body; prior: at the usual speed a third of its weight."""
        for body, v in rig.flying:
            scale = 0.3 * weight(rig.model, body) / max(rig.speed, 1e-6)
            parameter = Parameter("coefficient", "N s/m", scale, low=0.0, probe=0.01 * scale)
            yield cls(rig.model.body(body).name, v, parameter)

    def __init__(self, part: str, v: int, parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._v = v

    def force(self, state: State, values: Array) -> Array:
        """Against the velocity."""
        force = np.zeros_like(state.v)
        force[:, self._v : self._v + 3] = -values[0] * state.v[:, self._v : self._v + 3]
        return force

    def note(self, values: Array) -> str:
        """The law."""
        return freely(self.part, f"-{values[0]:.4g} v")
