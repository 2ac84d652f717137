"""A spring at a joint."""

from collections.abc import Iterator

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint


class Spring(JointEffect):
    name = "spring"
    physics = "Cables, hoses or a balance pull the joint towards an angle."
    source = "Arakelian (2016), Advanced Robotics 30(2)"
    phrase = "a spring at {part}"
    empirical = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Spring"]:
        """One for each joint; prior: a third of the usual torque, over the usual travel and at its middle."""
        for joint in rig.joints:
            scale = 0.3 * joint.torque / joint.travel
            unit = f"{joint.unit}/{joint.angle_unit}"
            nominal = float(rig.model.jnt_stiffness[rig.model.dof_jntid[joint.v]])
            yield cls(
                joint,
                Parameter("stiffness", unit, scale, low=-nominal, probe=0.01 * scale),
                Parameter("torque", joint.unit, 0.3 * joint.torque, probe=0.003 * joint.torque),
            )

    def __init__(self, joint: Joint, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters)
        self._joint = joint

    def force(self, state: State, values: Array) -> Array:
        """Towards the rest angle, about the middle of the motion."""
        j = self._joint
        pull = values[1] - values[0] * (state.q[:, j.q] - j.middle)
        return on_joint(j, pull, state.v.shape[1])

    def note(self, values: Array) -> str:
        """The law."""
        return self._joint.note(f"{values[1]:.4g} - {values[0]:.4g} (q - {self._joint.middle:.4g})")
