"""Stribeck friction: dry friction that decreases with speed."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint
from slapshot.effects.joints.parts import add_friction


class StribeckFriction(JointEffect):
    name = "stribeck_friction"
    physics = "Dry friction is larger near rest and falls with speed until a lubricant film carries."
    source = "Stribeck (1902); Armstrong-Helouvry et al. (1994), Automatica 30(7)"
    phrase = "friction at {part} that falls with speed (Stribeck)"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["StribeckFriction"]:
        """One for each joint; prior: as dry friction, and the same again below a seventh of the rms speed."""
        for joint in rig.joints:
            scale = 0.3 * joint.torque
            nominal = float(rig.model.dof_frictionloss[joint.v])
            speed = 0.15 * joint.speed
            unit = f"{joint.angle_unit}/s"
            yield cls(
                joint,
                Parameter("torque", joint.unit, scale, low=-nominal, probe=1e-3 * scale),
                Parameter("excess", joint.unit, scale, low=0.0, probe=1e-3 * scale),
                Parameter("speed", unit, 0.7 * speed, speed, 0.2 * speed, 10 * speed),
            )

    def __init__(self, joint: Joint, *parameters: Parameter) -> None:
        """With all three parameters, or with the excess and the speed, beside another dry friction."""
        super().__init__(joint.name, parameters)
        self._joint = joint

    @property
    def has_level(self) -> bool:
        """Whether the friction at speed is a parameter."""
        return self.parameters[0].name == "torque"

    @property
    def near_rest(self) -> "StribeckFriction":
        """The excess alone, where another effect has the friction at speed."""
        return StribeckFriction(self._joint, *self.parameters[-2:])

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add the friction at speed to the joint's friction loss."""
        if self.has_level:
            add_friction(model, self._joint.v, values[0])

    def force(self, state: State, values: Array) -> Array:
        """The excess near rest."""
        v, (excess, speed) = state.v[:, self._joint.v], values[-2:]
        falling = np.exp(-((v / speed) ** 2))
        return on_joint(
            self._joint, -excess * falling * np.tanh(v / self._joint.step_speed), state.v.shape[1]
        )

    def note(self, values: Array) -> str:
        """The excess; "" where there is none, and the friction loss is all."""
        excess, speed = values[-2:]
        if not excess:
            return ""
        j = self._joint
        return j.note(f"-{excess:.4g} exp(-(v / {speed:.4g})^2) tanh(v / {j.step_speed:.4g})")
