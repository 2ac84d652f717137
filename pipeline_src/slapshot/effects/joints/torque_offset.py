"""A constant torque at a joint."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint


class TorqueOffset(JointEffect):
    name = "torque_offset"
    physics = (
        "A drive's current has an offset, or a cable pulls: a constant torque acts beside the recorded one."
    )
    source = "Janot, Vandanjon, Gautier (2014), IEEE Transactions on Control Systems Technology 22(1)"
    phrase = "a constant force at {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["TorqueOffset"]:
        """One for each joint; prior: a third of the usual torque."""
        for joint in rig.joints:
            scale = 0.3 * joint.torque
            yield cls(joint, Parameter("torque", joint.unit, scale, probe=0.01 * scale))

    def __init__(self, joint: Joint, parameter: Parameter) -> None:
        super().__init__(joint.name, (parameter,))
        self.joint = joint

    def force(self, state: State, values: Array) -> Array:
        """Constant."""
        return on_joint(self.joint, np.full(len(state.v), values[0]), state.v.shape[1])

    def note(self, values: Array) -> str:
        """The torque."""
        return self.joint.note(f"a constant {values[0]:.4g}")
