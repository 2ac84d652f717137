"""Elasticity between motor and link."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Parameter, RigMotion
from slapshot.effects.joints.split import (
    AT_LINK,
    AT_MOTOR,
    FASTEST,
    SplitJoint,
    deflection,
    split_joints,
    stiffest,
)


class JointElasticity(SplitJoint):
    name = "joint_elasticity"
    physics = (
        "Gear, belt or shaft twist under load: motor and link have an angle each, with a spring between."
    )
    source = "Spong (1987), Journal of Dynamic Systems, Measurement, and Control 109(4)"
    phrase = "elasticity of joint {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["JointElasticity"]:
        """One for each driven joint, read at motor or link; prior: 10 mrad or .3 mm under the usual load."""
        for joint in split_joints(rig):
            usual = 0.01 if joint.angle_unit == "rad" else 3e-4
            least = 1 / stiffest(joint, float(rig.model.dof_armature[joint.v]))
            compliance = max(usual / joint.torque, 3 * least)
            unit = f"{joint.angle_unit}/({joint.unit})"
            damping = 0.2 * np.sqrt(joint.inertia / compliance)
            yield from (
                cls(
                    joint,
                    variant,
                    Parameter("compliance", unit, compliance, compliance, least, 100 * compliance),
                    Parameter("damping", f"{joint.unit} s/{joint.angle_unit}", damping, damping, 0.0),
                )
                for variant in (AT_MOTOR, AT_LINK)
            )

    @property
    def fastest(self) -> float:
        """Of the stiffest spring that is fitted."""
        return FASTEST

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Spring and damper between motor and link."""
        joint = model.joint(deflection(self.part))
        model.jnt_stiffness[joint.id] = 1 / values[0]
        model.dof_damping[joint.dofadr[0]] = values[1]

    def static_deflection(self, load: Array) -> Array:
        """Static deflection of the link under a load (N m or N)."""
        return -self.parameters[0].start * load
