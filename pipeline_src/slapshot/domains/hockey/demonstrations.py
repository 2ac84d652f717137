"""Scripted hits in joint space for given headings, speeds and contact points, by inverse kinematics.

The wrist moves along the heading at constant height while axis 6 swings the stick like a pendulum, so
that the blade is vertical, at its lowest point and at full speed when it meets the puck.
"""

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.config.trajectories import ScriptedHits
from slapshot.domains.hockey.model import BLADE_HALF_SIZE, STICK_LENGTH, WRIST_TO_FLANGE
from slapshot.scenes.scene import Scene
from slapshot.trajectories.inverse_kinematics import InverseKinematics

# Initial guess of inverse kinematics: a pose over the puck with the elbow up, which keeps it on one branch.
SEED_POSE = (0.0, -0.34, 0.0, 1.51, 0.0, -1.31, 0.0)
# Share of the blade's speed that comes from the swing of the stick; the rest comes from the motion of the
# wrist. For a hit straight ahead at 2 m/s, more would exceed the speed limit of axis 6, less those of axes 2
# and 4.
PENDULUM_SHARE = 0.75
BLADE_CLEARANCE = 0.010  # m, between blade and board at contact
CONTACT_AT = 0.75  # share of the duration; the follow-through is short so that blade and puck separate


def draw_task(settings: ScriptedHits, rng: np.random.Generator) -> dict[str, float]:
    """Draw a heading (rad), a blade speed at contact (m/s) and a contact point along the blade (m)."""
    return {
        "heading": rng.uniform(-settings.heading_rad, settings.heading_rad),
        "speed": rng.uniform(settings.speed_m_s[0], settings.speed_m_s[1]),
        "contact_offset": rng.uniform(-1, 1) * settings.contact_offset_m,
    }


def demonstrate(scene: Scene, settings: ScriptedHits, tasks: list[dict[str, float]]) -> list[Array | None]:
    """Waypoints (waypoints, 7) in rad at equal times over the duration, None where out of reach."""
    model = mujoco.MjModel.from_xml_string(scene.xml)
    arm = InverseKinematics(model, model.site(scene.info.striker_site).id, list(scene.info.joints))
    headings, speeds, offsets = (
        np.array([task[key] for task in tasks]) for key in ("heading", "speed", "contact_offset")
    )
    pose = np.tile(SEED_POSE, (len(tasks), 1))
    pose[:, 0] = headings
    found = np.empty((len(tasks), settings.waypoints, pose.shape[1]))
    left = np.arange(len(tasks))
    for i, travel in enumerate(blade_travel(settings.waypoints, settings.duration_s)):
        places, turns = _blade_poses(scene, headings[left], offsets[left], travel * speeds[left])
        pose[left], reached = arm.solve(pose[left], places, turns)
        left = left[reached]
        found[left, i] = pose[left]
    within_reach = set(left.tolist())
    return [found[k] if k in within_reach else None for k in range(len(tasks))]


def blade_travel(waypoints: int, duration: float) -> Array:
    """(waypoints,) distance in m past the point of contact, for a blade speed of 1 m/s at contact.

    The speed follows a smooth step (10 u^3 - 15 u^4 + 6 u^5) up to contact and back to rest, so that the
    position has a continuous third derivative.
    """
    fine = np.linspace(0, 1, 100 * (waypoints - 1) + 1)
    rising = fine <= CONTACT_AT
    u = np.where(rising, fine / CONTACT_AT, (1 - fine) / (1 - CONTACT_AT))
    speed = u**3 * (10 - 15 * u + 6 * u**2)
    travelled = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
    travelled *= duration
    return (travelled - np.interp(CONTACT_AT, fine, travelled))[::100]


def _blade_poses(scene: Scene, headings: Array, offsets: Array, distances: Array) -> tuple[Array, Array]:
    """Positions (n, 3) and rotations (n, 3, 3) of the blade site, `distances` m past the point of contact."""
    info, n = scene.info, len(headings)
    up = np.broadcast_to([0.0, 0.0, 1.0], (n, 3))
    ahead = np.stack([np.cos(headings), np.sin(headings), np.zeros(n)], axis=1)
    aside = np.cross(up, ahead)
    lever = WRIST_TO_FLANGE + STICK_LENGTH - BLADE_HALF_SIZE[2]
    tilt = (PENDULUM_SHARE * distances / lever)[:, None]
    contact = np.array([*info.start, BLADE_CLEARANCE + BLADE_HALF_SIZE[2]])
    contact = contact - ahead * (info.object_radius + info.striker_half_thickness)
    places = contact + ahead * distances[:, None] + up * lever * (1 - np.cos(tilt)) + aside * offsets[:, None]
    normal = np.cos(tilt) * ahead + np.sin(tilt) * up
    along_stick = np.sin(tilt) * ahead - np.cos(tilt) * up
    return places, np.stack([normal, np.cross(along_stick, normal), along_stick], axis=2)
