"""Viscous friction."""

from collections.abc import Iterator

import mujoco

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion


class ViscousFriction(JointEffect):
    name = "viscous_friction"
    physics = "Lubricant in bearings and gears resists in proportion to speed."
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
    phrase = "viscous friction at {part}"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["ViscousFriction"]:
        """One for each joint; prior: at the usual speed it takes a third of the usual torque."""
        for joint in rig.joints:
            scale = 0.3 * joint.torque / joint.speed
            damping = float(rig.model.dof_damping[joint.v])
            unit = f"{joint.unit} s/{joint.angle_unit}"
            yield cls(joint, Parameter("coefficient", unit, scale, low=-damping, probe=1e-3 * scale))

    def __init__(self, joint: Joint, parameter: Parameter) -> None:
        super().__init__(joint.name, (parameter,))
        self._joint = joint

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add to the joint's damping."""
        model.dof_damping[self._joint.v] += values[0]
