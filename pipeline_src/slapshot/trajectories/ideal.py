"""Swings of an arm that tracks its commands exactly: kinematics instead of a simulation.

An arm with servos has a tracking error of 1.5 mrad and 0.03 rad/s (rms), which moves rest points by 8 to 10
mm in the median; the start errors of the randomisation move them further. Ideal swings take a twentieth of
the time of simulated ones and are meant for methods that need hundreds of thousands of new commands.
"""

import numpy as np

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene
from slapshot.trajectories.execution import SETTLE, windowed
from slapshot.trajectories.kinematics import site_poses
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae

_EVERY = 5  # ticks between computed poses of the striker; linear interpolation in between


def ideal_swings(scene: Scene, model: TrajectoryVae, latents: Array) -> Swings:
    """Swings of latents (n, latent), all in the split `train`; without safety checks."""
    info = scene.info
    ticks = round((model.sizes.duration + SETTLE) / info.control_period)
    times = np.arange(ticks, dtype=np.float64) * info.control_period
    motion = Motion.through(model.waypoints(latents).swapaxes(0, 1), model.sizes.duration)
    positions, velocities = (x.swapaxes(0, 1) for x in (motion.position(times), motion.velocity(times)))
    targets = positions + info.servo_time * velocities  # as in Motion.servo_targets
    splits = np.zeros(len(latents), np.int64)
    return windowed(scene, latents, splits, targets, positions, velocities, *_striker(scene, positions))[0]


def _striker(scene: Scene, positions: Array) -> tuple[Array, Array]:
    """Position in m and normal of the striker, (n, t, 3) each, for joint positions (n, t, j) in rad."""
    count, ticks, joints = positions.shape
    knots = np.unique([*range(0, ticks, _EVERY), ticks - 1])
    model, names = scene.compile(), list(scene.info.joints)
    poses = site_poses(model, scene.layout.striker_site, names, positions[:, knots].reshape(-1, joints))
    found = poses.reshape(count, len(knots), 6)
    before = np.minimum(np.arange(ticks) // _EVERY, len(knots) - 2)
    share = ((np.arange(ticks) - knots[before]) / np.diff(knots)[before])[:, None]
    between = found[:, before]
    between += share * (found[:, before + 1] - between)
    return between[..., :3], between[..., 3:]
