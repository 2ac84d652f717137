"""An actuator that gives more or less than it is told."""

from collections.abc import Iterator

import mujoco

from slapshot.effects.joints.effect import Array, JointEffect, Parameter, Situation, servo
from slapshot.effects.joints.parts import shown


class ActuatorGain(JointEffect):
    name = "actuator_gain"
    physics = "Motor constant, current sensing or servo stiffness differ from the model's by a factor."
    source = "Grotjahn, Daemi, Heimann (2001), Robotica 19(5)"
    phrase = "gain of actuator {part}"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["ActuatorGain"]:
        """One an actuator; prior: a fifth."""
        for actuator in range(rig.model.nu):
            name = shown(rig.model.actuator(actuator).name)
            yield cls(name, actuator, Parameter("excess", "1", 0.2, low=-0.95, probe=1e-3))

    def __init__(self, part: str, actuator: int, parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._actuator = actuator

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Scale the gain; of a servo with its stiffness."""
        model.actuator_gainprm[self._actuator, 0] *= 1 + values[0]
        if servo(model, self._actuator):
            model.actuator_biasprm[self._actuator, 1] *= 1 + values[0]
