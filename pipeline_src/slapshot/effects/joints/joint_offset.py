"""Zero offset of a joint."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Observed, Parameter, RigMotion, servo


class JointOffset(JointEffect):
    name = "joint_offset"
    physics = "The encoder was zeroed in another pose: what is read and told is off by a constant angle."
    source = "Mooring, Roth, Driels, Fundamentals of Manipulator Calibration (1991)"
    phrase = "zero of joint {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["JointOffset"]:
        """One for each joint; prior: 0.1 rad, or 20 mm; different conventions differ by more."""
        for joint in rig.joints:
            columns = tuple(
                s.column for s in rig.sensed if s.joint == joint.name and s.quantity == "position"
            )
            scale = 0.1 if joint.angle_unit == "rad" else 0.02
            parameter = Parameter("offset", joint.angle_unit, scale, probe=1e-4)
            yield cls(joint, columns, parameter, "of the geometry")
            if columns and any(servo(rig.model, a) for a in joint.actuators):
                yield cls(joint, columns, parameter, "of the encoder that is recorded alone")

    def __init__(self, joint: Joint, columns: tuple[int, ...], parameter: Parameter, variant: str) -> None:
        super().__init__(joint.name, (parameter,), variant)
        self._joint, self._columns, self._geometry = joint, columns, "geometry" in variant

    @property
    def misreads(self) -> bool:
        """Not where links stand otherwise, however far: the forces on them tell it."""
        return not self._geometry

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Turn the link back by the offset: at a reading of q it stands where the model has it at q - offset.

        Servo, springs and limits keep the readings that the model has them at.
        """
        if self._geometry:
            model.qpos0[self._joint.q] += values[0]

    def observe(self, seen: Observed, values: Array) -> Array | None:
        """Add to the reading."""
        if self._geometry:
            return None
        added = np.zeros_like(seen.y)
        added[:, list(self._columns)] = values[0]
        return added

    def note(self, values: Array) -> str:
        """The offset, if it is not in the model."""
        if self._geometry:
            return ""
        return f"Add {values[0]:.4g} {self._joint.angle_unit} to simulated readings of joint {self.part}."
