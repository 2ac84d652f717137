"""A gear or shaft that gives way between motor and link."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.effects.joints.effect import Array, Joint, JointEffect, Parameter, Situation
from slapshot.effects.joints.split import FASTEST, deflection, read_at_link, split_joint, stiffest


class JointElasticity(JointEffect):
    name = "joint_elasticity"
    physics = (
        "Gear, belt or shaft twist under load: motor and link have an angle each, with a spring between."
    )
    source = "Spong (1987), Journal of Dynamic Systems, Measurement, and Control 109(4)"
    phrase = "elasticity of joint {part}"
    hidden_state = True

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["JointElasticity"]:
        """One a driven joint, read at the motor or at the link; prior: 10 mrad under the usual torque."""
        for joint in rig.joints:
            if not joint.actuators:
                continue
            least = 1 / stiffest(joint, float(rig.model.dof_armature[joint.v]))
            compliance = max(0.01 / joint.torque, 3 * least)
            unit = f"{joint.angle_unit}/({joint.unit})"
            damping = 0.2 * np.sqrt(joint.inertia / compliance)
            yield from (
                cls(
                    joint,
                    variant,
                    Parameter("compliance", unit, compliance, compliance, least, 100 * compliance),
                    Parameter("damping", f"{joint.unit} s/{joint.angle_unit}", damping, damping, 0.0),
                )
                for variant in ("read at the motor", "read at the link")
            )

    def __init__(self, joint: Joint, variant: str, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters, variant)
        self._joint = joint

    @property
    def reads_link(self) -> bool:
        """Whether the encoder sits behind the spring."""
        return "link" in self.variant

    @property
    def fastest(self) -> float:
        """Of the stiffest spring that is fitted."""
        return FASTEST

    @property
    def added_joint(self) -> str:
        """By how much the link stands ahead of the motor."""
        return deflection(self.part)

    def restructure(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Split the joint."""
        split_joint(spec, self.part, 0.1 * self._joint.inertia)
        return spec

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Spring and damper between motor and link."""
        joint = model.joint(deflection(self.part))
        model.jnt_stiffness[joint.id] = 1 / values[0]
        model.dof_damping[joint.dofadr[0]] = values[1]

    def static_deflection(self, load: Array) -> Array:
        """Where the link stands behind the motor under a load (N m or N) that it takes to move it."""
        return -self.parameters[0].start * load

    def note(self, values: Array) -> str:
        """What the encoder reads, where that is not the joint that the model had."""
        return read_at_link(self.part) if self.reads_link else ""
