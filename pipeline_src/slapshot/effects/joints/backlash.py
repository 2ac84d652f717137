"""Backlash between motor and link."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Parameter, RigMotion
from slapshot.effects.joints.split import AT_LINK, AT_MOTOR, SplitJoint, deflection, split_joints

_HIT = 1000.0  # rad/s, of the stop: four steps of a time constant
HARD_S = 0.004  # time constant of the stop: twice the step of a careful simulation


class Backlash(SplitJoint):
    name = "backlash"
    physics = "Teeth have play: the link is free within a gap and is driven at its ends."
    source = "Nordin, Gutman (2002), Automatica 38(10)"
    phrase = "backlash of joint {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Backlash"]:
        """One for each driven joint, read at the motor or at the link.

        Prior: a gap of 10 mrad either way, or .3 mm.
        """
        for joint in split_joints(rig):
            gap = 0.01 if joint.angle_unit == "rad" else 3e-4
            damping = 0.05 * joint.torque / joint.speed
            for variant in (AT_MOTOR, AT_LINK):
                yield cls(
                    joint,
                    variant,
                    Parameter("half_gap", joint.angle_unit, gap, gap, 1e-3 * gap, 30 * gap),
                    Parameter("damping", f"{joint.unit} s/{joint.angle_unit}", damping, damping, 0.0),
                )

    @property
    def fastest(self) -> float:
        """Of a stop that is hit."""
        return _HIT

    def restructure(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Split the joint; joint limits act as stops, since stiff springs could not be simulated."""
        spec = super().restructure(spec)
        second = spec.joint(deflection(self.part))
        second.limited, second.range, second.solref_limit = True, [-0.01, 0.01], [HARD_S, 1.0]
        return spec

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Width of the gap."""
        joint = model.joint(deflection(self.part))
        model.jnt_range[joint.id] = -values[0], values[0]
        model.dof_damping[joint.dofadr[0]] = values[1]

    def static_deflection(self, load: Array) -> Array:
        """Static deflection of the link under a load (N m or N)."""
        usual = max(0.1 * float(np.std(load)), 1e-12)
        return -self.parameters[0].start * np.tanh(load / usual)
