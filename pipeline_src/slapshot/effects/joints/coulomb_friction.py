"""Coulomb friction: a constant torque against the motion."""

from collections.abc import Iterator

import mujoco

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import add_friction


class CoulombFriction(JointEffect):
    name = "coulomb_friction"
    physics = "Bearings and gears resist with a constant torque against the motion, and hold at rest."
    source = "Olsson et al. (1998), European Journal of Control 4(3)"
    phrase = "Coulomb friction at {part}"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["CoulombFriction"]:
        """One for each joint; prior: a third of the usual torque."""
        for joint in rig.joints:
            scale = 0.3 * joint.torque
            nominal = float(rig.model.dof_frictionloss[joint.v])
            yield cls(joint, Parameter("torque", joint.unit, scale, low=-nominal, probe=1e-3 * scale))

    def __init__(self, joint: Joint, parameter: Parameter) -> None:
        super().__init__(joint.name, (parameter,))
        self._joint = joint

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add to the joint's friction loss."""
        add_friction(model, self._joint.v, values[0])
