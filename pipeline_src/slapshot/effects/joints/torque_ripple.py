"""Periodic torque over the angle (cogging)."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint

HARMONICS = (2, 3)
MOST = 18  # number of orders, spaced by half a period over the travel


class TorqueRipple(JointEffect):
    name = "torque_ripple"
    physics = "Magnets, teeth and harmonic gears make a torque that repeats with the angle (cogging)."
    source = "Islam, Mir, Sebastian (2004), IEEE Transactions on Industry Applications 40(3)"
    phrase = "torque ripple at {part}"
    many_forms = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["TorqueRipple"]:
        """One for each joint and start of its period; periods that are shorter are detected in the data."""
        for joint in rig.joints:
            for order in cls.spacing(joint) * np.arange(1.5, 1.5 + MOST):
                yield cls.at(joint, float(order))

    @classmethod
    def at(cls, joint: Joint, order: float) -> "TorqueRipple":
        """With an order to start from; prior: a tenth of the usual torque."""
        scale, apart = 0.1 * joint.torque, cls.spacing(joint)
        return cls(
            joint,
            Parameter("sine", joint.unit, scale, probe=0.01 * scale),
            Parameter("cosine", joint.unit, scale, probe=0.01 * scale),
            Parameter("order", f"1/{joint.angle_unit}", 0.5 * apart, order, low=apart),
        )

    @staticmethod
    def spacing(joint: Joint) -> float:
        """Spacing at which orders are distinguishable over the travel; longer periods are springs."""
        return float(np.pi / (2.5 * joint.travel))

    def __init__(self, joint: Joint, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters)
        self._joint = joint
        self.start_order = parameters[2].start

    def on(self, rig: RigMotion) -> "TorqueRipple":
        """The same ripple at the joint of that name."""
        return TorqueRipple({joint.name: joint for joint in rig.joints}[self.part], *self.parameters)

    @property
    def key(self) -> str:
        """With the order at which a fit begins."""
        return f"{super().key} from order {self.start_order:.4g}"

    def force(self, state: State, values: Array) -> Array:
        """A sine of the angle."""
        j = self._joint
        angle = values[2] * (state.q[:, j.q] - j.middle)
        ripple = values[0] * np.sin(angle) + values[1] * np.cos(angle)
        return on_joint(j, ripple, state.v.shape[1])

    def deviations(self, state: State, values: Array) -> Array:
        """Harmonics, as no ripple is a pure sine."""
        j, size = self._joint, float(np.hypot(values[0], values[1]))
        angle = values[2] * (state.q[:, j.q] - j.middle)
        waves = [size * wave(n * angle) for n in HARMONICS for wave in (np.sin, np.cos)]
        return np.stack([on_joint(j, wave, state.v.shape[1]) for wave in waves], axis=-1)

    def same_as(self, values: Array) -> str:
        """Its amplitude, and its phase at angle 0."""
        sine, cosine, order = (float(value) for value in values)
        phase = np.arctan2(cosine, sine) - order * self._joint.middle
        phase = (phase + np.pi) % (2 * np.pi) - np.pi
        return (
            f"{np.hypot(sine, cosine):.4g} {self._joint.unit} * sin({order:.5g} q {phase:+.4f}) at position q"
        )

    def note(self, values: Array) -> str:
        """The law."""
        angle = f"{values[2]:.6g} (q - {self._joint.middle:.6g})"
        return self._joint.note(f"{values[0]:.4g} sin({angle}) + {values[1]:.4g} cos({angle})")
