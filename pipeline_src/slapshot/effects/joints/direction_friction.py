"""Dry friction that is larger in one direction."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.effects.joints.effect import Array, Joint, JointEffect, Parameter, Situation, State, on_joint


class DirectionFriction(JointEffect):
    name = "direction_friction"
    physics = "Preload or a worn flank makes dry friction larger in one direction than in the other."
    source = "Armstrong (1988), ICRA; Swevers et al. (2007), IEEE Control Systems 27(5)"
    phrase = "friction at {part} that differs between directions"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["DirectionFriction"]:
        """One a joint; prior: as dry friction, and as much between the directions."""
        for joint in rig.joints:
            scale = 0.3 * joint.torque
            nominal = float(rig.model.dof_frictionloss[joint.v])
            yield cls(
                joint,
                Parameter("torque", joint.unit, scale, low=-nominal, probe=0.01 * scale),
                Parameter("difference", joint.unit, scale, probe=0.01 * scale),
            )

    def __init__(self, joint: Joint, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters)
        self._joint = joint

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add the mean of both directions to the joint's friction loss."""
        model.dof_frictionloss[self._joint.v] += values[0]

    def force(self, state: State, values: Array) -> Array:
        """Half the difference, against the positive direction, while it moves."""
        j = self._joint
        moving = np.tanh(state.v[:, j.v] / j.step_speed) ** 2
        return on_joint(j, -0.5 * values[1] * moving, state.v.shape[1])
