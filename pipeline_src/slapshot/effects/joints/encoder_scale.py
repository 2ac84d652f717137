"""Scale error of an encoder."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Observed, Parameter, RigMotion, servo


class EncoderScale(JointEffect):
    name = "encoder_scale"
    physics = "Gear ratio or counts per turn are wrong: readings are off by a factor."
    source = "Mooring, Roth, Driels, Fundamentals of Manipulator Calibration (1991)"
    phrase = "scale of the encoder of {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["EncoderScale"]:
        """One for each joint that is observed; prior: 2 %."""
        for joint in rig.joints:
            columns = tuple(
                s.column
                for s in rig.sensed
                if s.joint == joint.name and s.quantity in ("position", "velocity")
            )
            if not columns:
                continue
            parameter = Parameter("excess", "1", 0.02, probe=1e-4)
            yield cls(joint, columns, parameter, "of the recorded encoder alone")
            if any(servo(rig.model, a) for a in joint.actuators):
                yield cls(joint, columns, parameter, "that the servo reads too")

    def __init__(self, joint: Joint, columns: tuple[int, ...], parameter: Parameter, variant: str) -> None:
        super().__init__(joint.name, (parameter,), variant)
        self._joint, self._columns, self._servo = joint, list(columns), "servo" in variant

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """The servo uses the scaled reading."""
        if self._servo:
            for actuator in self._joint.actuators:
                if servo(model, actuator):
                    model.actuator_biasprm[actuator, 1:3] *= 1 + values[0]

    def observe(self, seen: Observed, values: Array) -> Array:
        """Scale the reading."""
        added = np.zeros_like(seen.y)
        added[:, self._columns] = values[0] * seen.y[:, self._columns]
        return added

    def note(self, values: Array) -> str:
        """The factor."""
        return f"Multiply simulated readings of joint {self.part}, about 0, by {1 + values[0]:.6g}."
