"""What the arm is led along: a motion at another pace, drifting off, late, and through a filter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array
from slapshot.trajectories.motion import Motion

# (ticks, joints) one a control period in s -> the same, as it gets through to the servos.
Filter = Callable[[Array, float], Array]


@dataclass(frozen=True, eq=False)
class ExecutedPath:
    """The commanded motion at another pace, late by `delay`, drifting off by the joint offset.

    Attributes:
        motion: as commanded.
        pace: factor on its speed.
        joint_offset: (joints,) rad, reached smoothly at the motion's end.
        delay: s.
        filters: through which commands pass, one after the other.
        settling: s that the filters go on moving after the motion's end.
    """

    motion: Motion
    pace: float
    joint_offset: Array
    delay: float = 0.0
    filters: Sequence[Filter] = ()
    settling: float = 0.0

    @property
    def duration(self) -> float:
        """S until the arm is to stand still."""
        return self.motion.duration / self.pace + self.delay + self.settling

    def position(self, times: Array) -> Array:
        """(times, joints) in rad, before the filters."""
        t = self._late(times)
        share = np.minimum(t / self._moving, 1.0)[:, None]
        return self.motion.position(self.pace * t) + share**2 * (3 - 2 * share) * self.joint_offset

    def targets(self, ticks: int, period: float, servo_time: float) -> Array:
        """(ticks, joints) in rad, what the servos are sent every `period` s: q + servo_time dq/dt."""
        times = period * np.arange(float(ticks))
        t = self._late(times)
        share = np.minimum(t / self._moving, 1.0)[:, None]
        drift = 6 * share * (1 - share) / self._moving * self.joint_offset
        velocity = self.pace * self.motion.velocity(self.pace * t) + drift
        return self._filtered(self.position(times) + servo_time * velocity, period)

    def led(self, every: float, period: float) -> tuple[Array, Array]:
        """Times (n,) in s, `every` s apart to the end, and joint positions (n, joints) then, filtered."""
        times = np.arange(0.0, self.duration + every, every)
        if not self.filters:
            return times, self.position(times)
        step = round(every / period)
        fine = period * np.arange(step * (len(times) - 1) + 1.0)
        return times, self._filtered(self.position(fine), period)[::step]

    @property
    def _moving(self) -> float:
        return self.motion.duration / self.pace

    def _late(self, times: Array) -> Array:
        return np.maximum(times - self.delay, 0.0)

    def _filtered(self, values: Array, period: float) -> Array:
        for pass_on in self.filters:
            values = pass_on(values, period)
        return values
