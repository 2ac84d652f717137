"""Buoyancy of a free body."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion, State
from slapshot.effects.joints.parts import freely, weight


class Buoyancy(JointEffect):
    name = "buoyancy"
    physics = "The air, or another fluid, lifts a light body by the weight of what it displaces (Archimedes)."
    source = "Batchelor, An Introduction to Fluid Dynamics (1967), section 1.4"
    phrase = "buoyancy of {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Buoyancy"]:
        """One for each free body, where there is gravity; prior: a fiftieth of its weight, as of a ball."""
        gravity = rig.model.opt.gravity
        size = float(np.linalg.norm(gravity))
        if size > 0:
            for body, v in rig.flying:
                heavy = weight(rig.model, body)
                parameter = Parameter("force", "N", 0.02 * heavy, low=0.0, probe=2e-4 * heavy)
                yield cls(rig.model.body(body).name, v, -gravity / size, heavy, parameter)

    def __init__(self, part: str, v: int, upwards: Array, weight: float, parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._v, self._upwards, self._weight = v, upwards, weight

    def force(self, state: State, values: Array) -> Array:
        """Constant, against gravity."""
        force = np.zeros_like(state.v)
        force[:, self._v : self._v + 3] = values[0] * self._upwards
        return force

    def note(self, values: Array) -> str:
        """The force."""
        share = values[0] / self._weight
        return freely(self.part, f"{values[0]:.4g} against gravity, which is a gravcomp of {share:.4g}")
