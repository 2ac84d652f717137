"""External pushes during some intervals."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint

_SAME_TIME_S = 1e-9
AT_KNOT = " at "  # in the name of a knot's force, after that of its push


@dataclass(frozen=True)
class Pulse:
    """An interval of an episode during which an external force acts.

    Attributes:
        episode: as recorded.
        order: normalised position of the episode in the session, -1/2 to 1/2.
        begin: s from the episode's start.
        end: s from the episode's start.
        knots: evenly spaced times, from begin to end, between which the force is linear; 1 for a constant.
    """

    episode: int
    order: float
    begin: float
    end: float
    knots: int = 1

    @property
    def times(self) -> Array:
        """(knots,) s."""
        return np.linspace(self.begin, self.end, self.knots)

    def shape(self, time: Array) -> Array:
        """(..., knots) what a unit value of each knot is at some times (...) in s of the episode."""
        during = (time >= self.begin - _SAME_TIME_S) & (time < self.end - _SAME_TIME_S)
        if self.knots == 1:
            return during[..., None].astype(float)
        spacing = (self.end - self.begin) / (self.knots - 1)
        hats = np.maximum(1 - np.abs(time[..., None] - self.times) / spacing, 0.0)
        return np.asarray(hats * during[..., None])


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
                Parameter(name, joint.unit, joint.torque, probe=0.01 * joint.torque)
                for i, pulse in enumerate(pulses)
                for name in self._names(i, pulse)
            ],
            self._when(pulses),
        )
        self._joint, self.pulses = joint, tuple(pulses)

    def on(self, rig: RigMotion) -> "ExternalPulse":
        """The same pushes at the joint of that name."""
        return ExternalPulse({joint.name: joint for joint in rig.joints}[self.part], self.pulses)

    def by_pulse(self, values: Array) -> list[tuple[Pulse, Array]]:
        """Each push with the values of its knots."""
        ends = np.cumsum([pulse.knots for pulse in self.pulses])
        return list(zip(self.pulses, np.split(values, ends[:-1]), strict=True))

    def only(self, kept: NDArray[np.bool_]) -> "ExternalPulse":
        """Some of the pushes."""
        return self.of([pulse for pulse, keep in zip(self.pulses, kept, strict=True) if keep])

    def of(self, pulses: Sequence[Pulse]) -> "ExternalPulse":
        """Other pushes of the same joint."""
        return ExternalPulse(self._joint, pulses)

    @staticmethod
    def _names(number: int, pulse: Pulse) -> list[str]:
        if pulse.knots == 1:
            return [f"push_{number}"]
        return [f"push_{number}{AT_KNOT}{time:.2f} s" for time in pulse.times]

    @staticmethod
    def _when(pulses: Sequence[Pulse]) -> str:
        texts = [f"{p.begin:.2f} to {p.end:.2f} s of episode {p.episode}" for p in pulses[:6]]
        more = f" and {len(pulses) - 6} more" if len(pulses) > 6 else ""
        return ", ".join(texts) + more

    def force(self, state: State, values: Array) -> Array:
        """A force in each interval, constant or linear between knots."""
        push = np.zeros(len(state.v))
        for pulse, own in self.by_pulse(values):
            during = np.abs(state.order - pulse.order) < _SAME_TIME_S
            during &= (state.time > pulse.begin - _SAME_TIME_S) & (state.time < pulse.end)
            push[during] += pulse.shape(state.time[during]) @ own
        return on_joint(self._joint, push, state.v.shape[1])

    def note(self, values: Array) -> str:
        """Sizes and times."""
        return self._joint.note("; ".join(self._told(*one) for one in self.by_pulse(values)))

    @staticmethod
    def _told(pulse: Pulse, values: Array) -> str:
        size = ", ".join(f"{value:.4g}" for value in values)
        between = ", linear between evenly spaced times" if pulse.knots > 1 else ""
        return f"{size} from {pulse.begin:.4g} to {pulse.end:.4g} s of episode {pulse.episode}{between}"
