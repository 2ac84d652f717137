"""Wind: a constant force on a free body."""

from collections.abc import Iterator, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion, State
from slapshot.effects.joints.parts import freely, level, weight


class Wind(JointEffect):
    name = "wind"
    physics = "A steady wind pushes a body with a constant force."
    source = "Batchelor, An Introduction to Fluid Dynamics (1967), chapter 5"
    phrase = "wind on {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Wind"]:
        """One for each free body; prior: a tenth of its weight, level."""
        for body, v in rig.flying:
            scale = 0.1 * weight(rig.model, body)
            axes = level(rig.model.opt.gravity)
            pushes = [Parameter(f"force_{'xyz'[a]}", "N", scale, probe=0.01 * scale) for a in axes]
            yield cls(rig.model.body(body).name, [v + axis for axis in axes], pushes)

    def __init__(self, part: str, dofs: list[int], parameters: Sequence[Parameter]) -> None:
        super().__init__(part, parameters)
        self._dofs = dofs

    def force(self, state: State, values: Array) -> Array:
        """Constant and level."""
        force = np.zeros_like(state.v)
        force[:, self._dofs] = values
        return force

    def note(self, values: Array) -> str:
        """The force."""
        pushes = zip(self.parameters, values, strict=True)
        return freely(self.part, "; ".join(f"{p.name} = {value:.4g}" for p, value in pushes))
