"""Joint motion through waypoints: a clamped cubic spline, at rest at both ends."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from slapshot.arrays import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


@dataclass(frozen=True)
class Motion:
    """Joint motion through equally spaced waypoints.

    Attributes:
        spline: joint positions (rad) over time (s).
        duration: s; the arm holds still afterwards.
    """

    spline: "CubicSpline"
    duration: float

    @classmethod
    def through(cls, waypoints: Array, duration: float) -> "Motion":
        """Interpolate waypoints (waypoints, joints) in rad."""
        from scipy.interpolate import CubicSpline  # slow to import, and not needed to train trajectory models

        times = np.linspace(0, duration, len(waypoints))
        return cls(CubicSpline(times, waypoints, bc_type="clamped"), duration)

    def position(self, times: Array) -> Array:
        """(times, joints) in rad."""
        return self.spline(np.minimum(times, self.duration))

    def velocity(self, times: Array) -> Array:
        """(times, joints) in rad/s."""
        return self.spline(np.minimum(times, self.duration), 1)

    def acceleration(self, times: Array) -> Array:
        """(times, joints) in rad/s^2."""
        return self.spline(np.minimum(times, self.duration), 2)

    def servo_targets(self, times: Array, servo_time: float) -> Array:
        """(times, joints): q + servo_time dq/dt, which cancels the lag of a servo's damping."""
        return self.position(times) + servo_time * self.velocity(times)
