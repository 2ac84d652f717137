"""Reflected rotor inertia."""

from collections.abc import Iterator

import mujoco

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion


class Armature(JointEffect):
    name = "armature"
    physics = "A rotor turns with its joint and adds its inertia times the square of the gear ratio."
    source = "Siciliano, Sciavicco, Villani, Oriolo, Robotics (2009), section 7.1"
    phrase = "rotor inertia at {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Armature"]:
        """One for each joint; prior: a third of the joint's inertia."""
        for joint in rig.joints:
            scale = 0.3 * joint.inertia
            nominal = float(rig.model.dof_armature[joint.v])
            unit = "kg m^2" if joint.unit == "N m" else "kg"
            yield cls(joint, Parameter("inertia", unit, scale, low=-0.99 * nominal, probe=1e-3 * scale))

    def __init__(self, joint: Joint, parameter: Parameter) -> None:
        super().__init__(joint.name, (parameter,))
        self._joint = joint

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add to the joint's armature."""
        model.dof_armature[self._joint.v] += values[0]
