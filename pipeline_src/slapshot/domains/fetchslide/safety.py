"""Safety check of a sequence of gripper velocities, and of the path to which it leads."""

import numpy as np

from slapshot.arrays import Array
from slapshot.domains.fetchslide.demonstrations import RESPONSE
from slapshot.domains.fetchslide.model import CONTROL_PERIOD, GRIP_START, TABLE_HALF, TABLE_MIDDLE
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyReport

MOST_COMMAND = 1.0  # the environment clips larger commands
# m above the gripper's start, where its fingers rest on the table: how far a decoded path may sink, and the
# largest height at which the fingers meet more than the rim of a puck that is 40 mm high.
LOWEST, HIGHEST = -0.002, 0.025
MARGIN = 0.05  # m, to the table's edge
# Largest change of a command between periods; demonstrations stop from 1 within three periods.
MOST_CHANGE = 0.8


class SafetyCheck:
    """Checks motions by integration; the positions of these motions are commanded velocities."""

    def __init__(self, scene: Scene) -> None:
        self._period = scene.info.control_period

    def report(self, motion: Motion) -> SafetyReport:
        """Check the size and smoothness of the commands, and the path of the gripper.

        `speed_share` is the largest command, `acceleration` the largest change per period over the period.
        """
        commands = motion.position(command_times(motion.duration, self._period))
        path = np.array(GRIP_START) + np.cumsum(commands * CONTROL_PERIOD * RESPONSE, axis=0)
        largest = float(np.abs(commands).max())
        change = float(np.abs(np.diff(commands, axis=0)).max())
        rise = path[:, 2] - GRIP_START[2]
        from_middle = path[:, :2] - np.array(TABLE_MIDDLE)
        from_middle[:, 0] = np.maximum(
            from_middle[:, 0], 0
        )  # towards the robot the gripper may leave the table
        beyond = np.abs(from_middle) > np.array(TABLE_HALF) - MARGIN
        reason = ""
        if not np.isfinite(commands).all():
            reason = "not finite"
        elif largest > MOST_COMMAND:
            reason = "a command is too fast"
        elif change > MOST_CHANGE:
            reason = "the commands are not smooth"
        elif rise.min() < LOWEST:
            reason = "too close to the table"
        elif rise.max() > HIGHEST:
            reason = "too high to meet the puck"
        elif beyond.any():
            reason = "beyond the table's edge"
        return SafetyReport(reason, largest, float(rise.min()), change / self._period)


def command_times(duration: float, period: float) -> Array:
    """(waypoints,) s, times of a motion's waypoints: one per control period, the last one at its end."""
    return np.linspace(0.0, duration, round(duration / period) + 1)
