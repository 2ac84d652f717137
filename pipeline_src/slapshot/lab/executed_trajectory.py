"""The executed trajectory: the commanded motion with another speed, joint offsets, a delay and filters."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array
from slapshot.trajectories.motion import Motion

# (ticks, joints) commands sampled once per control period, and that period in s -> the commands as they
# reach the servos, of the same shape.
Filter = Callable[[Array, float], Array]


@dataclass(frozen=True, eq=False)
class ExecutedPath:
    """The commanded motion with another speed, a delay, and a joint offset that grows along the motion.

    Attributes:
        motion: as commanded.
        pace: factor on the speed of execution.
        joint_offset: (joints,) rad, reached smoothly at the motion's end.
        delay: s.
        filters: applied to the commands one after the other.
        settling: s that the filters' output continues to change after the motion's end.
    """

    motion: Motion
    pace: float
    joint_offset: Array
    delay: float = 0.0
    filters: Sequence[Filter] = ()
    settling: float = 0.0

    @property
    def duration(self) -> float:
        """S until the arm should be at rest."""
        return self.motion.duration / self.pace + self.delay + self.settling

    def position(self, times: Array) -> Array:
        """(times, joints) in rad, unfiltered."""
        t = self._late(times)
        share = np.minimum(t / self._moving, 1.0)[:, None]
        return self.motion.position(self.pace * t) + share**2 * (3 - 2 * share) * self.joint_offset

    def targets(self, ticks: int, period: float, servo_time: float) -> Array:
        """(ticks, joints) in rad, servo targets sent every `period` s: q + servo_time dq/dt."""
        times = period * np.arange(float(ticks))
        t = self._late(times)
        share = np.minimum(t / self._moving, 1.0)[:, None]
        drift = 6 * share * (1 - share) / self._moving * self.joint_offset
        velocity = self.pace * self.motion.velocity(self.pace * t) + drift
        return self._filtered(self.position(times) + servo_time * velocity, period)

    def led(self, every: float, period: float) -> tuple[Array, Array]:
        """Times (n,) in s, `every` s apart up to the end, and filtered joint positions (n, joints)."""
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
