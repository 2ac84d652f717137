"""Load-dependent friction of a gear."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint


class LoadFriction(JointEffect):
    name = "load_friction"
    physics = "Teeth under load press on one another: friction is a share of the transmitted torque."
    source = "Hamon, Gautier, Garrec (2010), IROS"
    phrase = "friction at {part} that grows with load"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["LoadFriction"]:
        """One for each driven joint; prior: a tenth of the transmitted torque."""
        for joint in rig.joints:
            if joint.actuators:
                yield cls(joint, Parameter("share", "1", 0.1, low=0.0, high=1.0, probe=1e-3))

    def __init__(self, joint: Joint, parameter: Parameter) -> None:
        super().__init__(joint.name, (parameter,))
        self._joint = joint

    def force(self, state: State, values: Array) -> Array:
        """Against the motion."""
        j = self._joint
        against = -values[0] * np.abs(state.torque[:, j.v]) * np.tanh(state.v[:, j.v] / j.step_speed)
        return on_joint(j, against, state.v.shape[1])

    def note(self, values: Array) -> str:
        """The law."""
        j = self._joint
        return j.note(f"-{values[0]:.4g} |torque of its actuators| tanh(v / {j.step_speed:.4g})")
