"""External pushes during some intervals."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint


@dataclass(frozen=True)
class Pulse:
    """An interval of an episode during which an external force acts.

    Attributes:
        episode: as recorded.
        order: normalised position of the episode in the session, -1/2 to 1/2.
        begin: s from the episode's start.
        end: s from the episode's start.
    """

    episode: int
    order: float
    begin: float
    end: float


class ExternalPulse(JointEffect):
    name = "external_pulse"
    physics = "Somebody or something pushes for a while: a contact, a hand, a disturbance torque."
    source = "Haddadin, De Luca, Albu-Schäffer (2017), IEEE Transactions on Robotics 33(6)"
    phrase = "a push from outside at {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["ExternalPulse"]:
        """None: intervals are detected in the data first, see diagnosis.pulses."""
        return iter(())

    def __init__(self, joint: Joint, pulses: Sequence[Pulse]) -> None:
        super().__init__(
            joint.name,
            [
                Parameter(f"push_{i}", joint.unit, joint.torque, probe=0.01 * joint.torque)
                for i in range(len(pulses))
            ],
            self._when(pulses),
        )
        self._joint, self.pulses = joint, tuple(pulses)

    def on(self, rig: RigMotion) -> "ExternalPulse":
        """The same pushes at the joint of that name."""
        return ExternalPulse({joint.name: joint for joint in rig.joints}[self.part], self.pulses)

    def only(self, kept: NDArray[np.bool_]) -> "ExternalPulse":
        """Some of the pushes."""
        return ExternalPulse(
            self._joint, [pulse for pulse, keep in zip(self.pulses, kept, strict=True) if keep]
        )

    @staticmethod
    def _when(pulses: Sequence[Pulse]) -> str:
        texts = [f"{p.begin:.2f} to {p.end:.2f} s of episode {p.episode}" for p in pulses[:6]]
        more = f" and {len(pulses) - 6} more" if len(pulses) > 6 else ""
        return ", ".join(texts) + more

    def force(self, state: State, values: Array) -> Array:
        """A constant force in each interval."""
        push = np.zeros(len(state.v))
        for pulse, value in zip(self.pulses, values, strict=True):
            during = (
                (np.abs(state.order - pulse.order) < 1e-9)
                & (state.time >= pulse.begin - 1e-9)
                & (state.time < pulse.end - 1e-9)
            )
            push[during] += value
        return on_joint(self._joint, push, state.v.shape[1])

    def note(self, values: Array) -> str:
        """Sizes and times."""
        pushes = zip(self.pulses, values, strict=True)
        return self._joint.note(
            "; ".join(
                f"{v:.4g} from {p.begin:.4g} to {p.end:.4g} s of episode {p.episode}" for p, v in pushes
            )
        )
