"""Gain error of an actuator."""

from collections.abc import Iterator

import mujoco

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion, servo
from slapshot.effects.joints.parts import shown

_LINEAR = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))


class ActuatorGain(JointEffect):
    name = "actuator_gain"
    physics = "Motor constant, current sensing or servo stiffness differ from the model's by a factor."
    source = "Gautier, Briot (2014), ASME Journal of Dynamic Systems, Measurement, and Control 136(5)"
    phrase = "gain of actuator {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["ActuatorGain"]:
        """One for each actuator, and one for the stiffness alone of a servo with damping; prior: 20 %."""
        model, parameter = rig.model, Parameter("excess", "1", 0.2, low=-0.95, probe=1e-3)
        driven = {actuator: joint.name for joint in rig.joints for actuator in joint.actuators}
        for actuator in range(model.nu):
            if model.actuator_gaintype[actuator] not in _LINEAR:
                continue
            name, joint = shown(model.actuator(actuator).name), driven.get(actuator, "")
            if servo(model, actuator) and model.actuator_biasprm[actuator, 2] != 0:
                yield cls(name, actuator, joint, parameter, "of its whole force")
                yield cls(name, actuator, joint, parameter, "of its stiffness alone")
            else:
                yield cls(name, actuator, joint, parameter)

    def __init__(self, part: str, actuator: int, joint: str, parameter: Parameter, variant: str = "") -> None:
        super().__init__(part, (parameter,), variant)
        self._actuator, self._joint, self._stiffness = actuator, joint, "stiffness" in variant
        # A torque constant falls with current, so that an excess is not the same for all torques.
        self.empirical = bool(joint)

    @property
    def on_joint(self) -> str:
        """Name of the joint that the actuator drives."""
        return self._joint

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Scale the force, or its stiffness part only."""
        i, factor = self._actuator, 1 + values[0]
        if self._stiffness:
            model.actuator_gainprm[i, 0] *= factor
            model.actuator_biasprm[i, 1] *= factor
            return
        model.actuator_gainprm[i, :3] *= factor
        if model.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_AFFINE):
            model.actuator_biasprm[i, :3] *= factor
