"""Simulates swings of the gripper with the puck out of the way; they determine the puck's nominal start."""

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.domains.fetchslide.demonstrations import CONTACT_AT
from slapshot.domains.fetchslide.gripper import PUCK_HOME, Grippers
from slapshot.domains.fetchslide.model import FINGER_HALF_THICKNESS, PUCK_RADIUS
from slapshot.domains.fetchslide.safety import command_times
from slapshot.progress import progress
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import Swings, pose_stride
from slapshot.trajectories.vae import TrajectoryVae

LEAD = 3  # control periods before the nominal contact from which on states are kept
LEAST_SPEED = 0.15  # m/s of the gripper at contact
REACH = PUCK_RADIUS + FINGER_HALF_THICKNESS  # m, from grip to puck for a central contact
# m, additional distance up to which the gripper moves alone, because REACH neglects the fingers' corners.
CLEAR = 0.012
_FRICTION = np.array([0.1, 0.005, 0.0001])  # the environment's own; without effect, as the puck is far away


def execute(
    scene: Scene, model: TrajectoryVae, latents: Array, splits: NDArray[np.int64], cores: int
) -> tuple[Swings, NDArray[np.bool_]]:
    """Command the gripper along each latent's motion.

    The puck's nominal start is in front of the gripper at the time at which it reaches the puck in every
    demonstration.

    Returns:
        The swings, and (n,) whether the gripper is fast enough at contact and did not touch the puck before.
    """
    count = len(latents)
    times = command_times(model.sizes.duration, scene.info.control_period)
    commands = np.stack([model.motion(latent).position(times) for latent in latents])
    ticks, joints = len(times), len(scene.info.joints)
    robots, ids = Grippers(scene, count, cores), np.arange(count)
    robots.reset(ids, np.tile(PUCK_HOME[:2], (count, 1)), _FRICTION)
    grip = np.empty((count, ticks + 1, 3))
    positions, velocities = np.empty((2, count, ticks + 1, joints))
    for tick in progress(range(ticks), ticks, "executing swings"):
        grip[:, tick] = robots.grip(ids)
        positions[:, tick], velocities[:, tick] = robots.joints(ids)
        robots.command(ids, commands[:, tick])
    grip[:, ticks] = robots.grip(ids)
    positions[:, ticks], velocities[:, ticks] = robots.joints(ids)

    contact = round(CONTACT_AT * ticks)
    velocity = (grip[:, contact] - grip[:, contact - 1])[:, :2] / scene.info.control_period
    speed = np.linalg.norm(velocity, axis=1)
    ahead = velocity / np.maximum(speed, 1e-9)[:, None]
    starts = grip[:, contact, :2] + REACH * ahead
    first = contact - LEAD
    away = np.linalg.norm(grip[:, : first + 1, :2] - starts[:, None], axis=2).min(1)
    usable = (speed > LEAST_SPEED) & (away > REACH + CLEAR)
    normal = np.zeros((count, ticks, 3))
    normal[:, :, :2] = ahead[:, None]
    swings = Swings(
        latents=latents,
        splits=np.asarray(splits, np.int64),
        starts=starts,
        targets=commands,
        positions=positions[:, first : contact + 1],
        velocities=velocities[:, first : contact + 1],
        first=np.full(count, first),
        striker=grip[:, :ticks],
        normal=normal,
        poses=positions[:, :: pose_stride(scene.info.control_period)],
    )
    return swings, usable
