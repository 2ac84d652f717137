"""Sideways force on a spinning body (Magnus)."""

from collections.abc import Iterator, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion, State
from slapshot.effects.joints.parts import freely, weight


class SpinLift(JointEffect):
    name = "spin_lift"
    physics = "A spinning ball drags air round with it and is pushed across its trajectory (Magnus)."
    source = "Mehta (1985), Annual Review of Fluid Mechanics 17"
    phrase = "spin force on {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["SpinLift"]:
        """One for each free body; prior: at the usual speed a third of its weight.

        Its spin, the same in all episodes, is an axis times a strength.
        """
        for body, v in rig.flying:
            scale = 0.3 * weight(rig.model, body) / max(rig.speed, 1e-6)
            axes = [Parameter(f"spin_{axis}", "N s/m", scale, probe=0.01 * scale) for axis in "xyz"]
            yield cls(rig.model.body(body).name, v, axes)

    def __init__(self, part: str, v: int, parameters: Sequence[Parameter]) -> None:
        super().__init__(part, parameters)
        self._v = v

    def force(self, state: State, values: Array) -> Array:
        """Spin axis times velocity."""
        force = np.zeros_like(state.v)
        force[:, self._v : self._v + 3] = np.cross(values[None, :], state.v[:, self._v : self._v + 3])
        return force

    def note(self, values: Array) -> str:
        """The law."""
        x, y, z = values
        return freely(self.part, f"({x:.4g}, {y:.4g}, {z:.4g}) x v, a cross product")
