"""An actuator that cannot give as much as it is told."""

from collections.abc import Iterator

import mujoco

from slapshot.effects.joints.effect import Array, JointEffect, Parameter, Situation
from slapshot.effects.joints.parts import shown


class Saturation(JointEffect):
    name = "saturation"
    physics = "Current or torque is limited, by the amplifier or by its settings."
    source = "Grimm et al. (2003), IEEE Transactions on Automatic Control 48(9), section I"
    phrase = "torque limit of actuator {part}"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["Saturation"]:
        """One an actuator; the limit is told as the share of the largest recorded torque that is cut off."""
        for joint in rig.joints:
            for actuator in joint.actuators:
                if joint.largest > 0:
                    cut = Parameter("cut", "1", 0.4, low=0.0, high=0.98, probe=0.2)
                    yield cls(shown(rig.model.actuator(actuator).name), actuator, joint.largest, cut)

    def __init__(self, part: str, actuator: int, largest: float, parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._actuator, self._largest = actuator, largest

    @property
    def starts(self) -> tuple[tuple[float, ...], ...]:
        """A little and much cut off."""
        return ((0.1,), (0.3,), (0.6,))

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Limit the force."""
        limit = self._largest * (1 - values[0])
        low, high = -limit, limit
        if model.actuator_forcelimited[self._actuator]:
            nominal = model.actuator_forcerange[self._actuator]
            low, high = max(low, nominal[0]), min(high, nominal[1])
        if values[0] > 0:
            model.actuator_forcelimited[self._actuator] = 1
            model.actuator_forcerange[self._actuator] = low, high
