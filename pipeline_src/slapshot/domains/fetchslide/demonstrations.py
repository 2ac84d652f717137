"""Scripted pushes: the gripper moves behind a random point of the table and pushes away from the robot.

"[...] which move the arm to a random point on the table and push the object away from the robot with a random
angle and velocity" (paper, section IV-B). A waypoint is a command: the gripper's velocity, in units of the
environment's action.
"""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.config.trajectories import ScriptedHits
from slapshot.domains.fetchslide.model import CONTROL_PERIOD, FINGER_HALF_THICKNESS, GRIP_START, PUCK_RADIUS
from slapshot.errors import InputError
from slapshot.scenes.scene import Scene

# m/s, speed of the gripper for a command of 1 along an axis. The environment demands 0.05 m in 0.04 s, but
# relative to the gripper's actual position and through a soft weld. Measured; see
# tests/scenes/test_fetchslide.py.
RESPONSE = 0.8
LIFT = 0.008  # m, by which the fingers are lifted from the table, on which they rest initially
# Shares of the motion: fingers lifted, gripper behind the puck, contact, gripper at rest.
LIFTED_AT, BEHIND_AT, CONTACT_AT, STOPPED_AT = 0.2, 0.54, 0.79, 0.92


def draw_task(settings: ScriptedHits, rng: np.random.Generator) -> dict[str, float]:
    """Draw the puck's position (m), a heading (rad), the gripper's speed (m/s) and a lateral offset (m).

    Raises:
        InputError: the settings do not give the range of the puck's position.
    """
    if settings.place_m is None:
        raise InputError("key 'place_m' is missing; add it (where the puck lies, beside heading_rad)")
    x_low, x_high, y_low, y_high = settings.place_m
    return {
        "x": rng.uniform(x_low, x_high),
        "y": rng.uniform(y_low, y_high),
        "heading": rng.uniform(-settings.heading_rad, settings.heading_rad),
        "speed": rng.uniform(settings.speed_m_s[0], settings.speed_m_s[1]),
        "contact_offset": rng.uniform(-1, 1) * settings.contact_offset_m,
    }


def demonstrate(scene: Scene, settings: ScriptedHits, tasks: list[dict[str, float]]) -> list[Array | None]:
    """Commands (waypoints, 3), one per control period; None where the gripper cannot be that fast.

    Raises:
        InputError: duration_s does not fit the number of commands.
    """
    count = settings.waypoints
    if round(settings.duration_s / CONTROL_PERIOD) != count - 1:
        raise InputError(
            f"demonstrations.duration_s: {count} waypoints are commands {CONTROL_PERIOD} s apart; "
            f"write {(count - 1) * CONTROL_PERIOD:g}"
        )
    commands = [commands_of(task, count) for task in tasks]
    return [c if np.abs(c).max() <= 1 else None for c in commands]


def commands_of(task: Mapping[str, float], count: int) -> Array:
    """(count, 3) commands for two smooth moves of the gripper: to behind the puck, and through it."""
    share = np.arange(count + 1) / count
    ahead = np.array([np.cos(task["heading"]), np.sin(task["heading"])])
    aside = np.array([-ahead[1], ahead[0]])
    contact = np.array([task["x"], task["y"]]) + aside * task["contact_offset"]
    contact -= ahead * (PUCK_RADIUS + FINGER_HALF_THICKNESS)

    rising = smooth((share - BEHIND_AT) / (CONTACT_AT - BEHIND_AT))
    speed = task["speed"] * np.where(
        share <= CONTACT_AT, rising, 1 - smooth((share - CONTACT_AT) / (STOPPED_AT - CONTACT_AT))
    )
    travelled = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * CONTROL_PERIOD)])
    travelled -= np.interp(CONTACT_AT, share, travelled)
    behind = contact + ahead * travelled[0]
    start = np.array(GRIP_START)
    path = start[:2] + smooth(share / BEHIND_AT)[:, None] * (behind - start[:2])
    path += (travelled - travelled[0])[:, None] * ahead
    height = LIFT * smooth(share / LIFTED_AT)
    return np.diff(np.column_stack([path, height]), axis=0) / CONTROL_PERIOD / RESPONSE


def smooth(u: Array) -> Array:
    """Smooth step from 0 to 1 with two continuous derivatives, constant outside [0, 1]."""
    u = np.clip(u, 0, 1)
    return u**3 * (10 - 15 * u + 6 * u**2)
