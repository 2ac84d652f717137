"""Simulates swings of an arm with joint servos, without the object."""

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.progress import progress
from slapshot.scenes.scene import Scene
from slapshot.trajectories.kinematics import site_poses
from slapshot.trajectories.swings import Swings, pose_stride
from slapshot.trajectories.vae import TrajectoryVae

WINDOW_BEFORE, WINDOW_AFTER = 0.20, 0.12  # s around the nominal contact in which a hit may begin
SETTLE = 0.05  # s simulated after the motion's end
# Share of the torque limits that a swing may use; contact forces come on top.
TORQUE_SHARE = 0.8
_FAR = 100.0  # m, position of the object while the arm moves alone


def execute(
    scene: Scene, model: TrajectoryVae, latents: Array, splits: NDArray[np.int64], cores: int
) -> tuple[Swings, NDArray[np.bool_]]:
    """Move the arm along each latent's motion, with the object out of the way.

    Returns:
        The swings, and (n,) whether speeds and torques stay within limits and the object is reached.
    """
    info, layout = scene.info, scene.layout
    mj_model = scene.compile()
    # The object is far away and the model has no contacts of the arm; collision detection would take a third
    # of the time.
    mj_model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    substeps = round(info.control_period / mj_model.opt.timestep)
    ticks = round((model.sizes.duration + SETTLE) / info.control_period)
    times = np.arange(ticks, dtype=np.float64) * info.control_period
    motions = [model.motion(latent) for latent in latents]
    targets = np.stack([motion.servo_targets(times, info.servo_time) for motion in motions])
    count, joints = len(latents), len(info.joints)

    batch = Batch(mj_model, nsim=count, nthread=cores)
    batch.reset()
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    force = batch.bind("actuator_force")
    # All joints except the object's, because links may be attached by springs besides the arm's own joints.
    names = [mj_model.joint(j).name for j in range(mj_model.njnt)]
    names = [name for name in names if name not in info.object_joints]
    moving = [mj_model.joint(name).qposadr[0] for name in names]
    qpos[:, layout.arm_q] = np.stack([motion.position(times[:1])[0] for motion in motions])
    qpos[:, layout.object_q[0]] += _FAR
    positions, velocities = np.empty((2, count, ticks, joints))
    poses, torque = np.empty((count, ticks, len(names))), np.zeros((count, joints))
    for tick in progress(range(ticks), ticks, "executing swings"):
        positions[:, tick], velocities[:, tick] = qpos[:, layout.arm_q], qvel[:, layout.arm_v]
        poses[:, tick] = qpos[:, moving]
        ctrl[:, :joints] = targets[:, tick]
        batch.step(nstep=substeps)
        torque = np.maximum(torque, np.abs(force[:, :joints]))
    seen = site_poses(mj_model, layout.striker_site, names, poses.reshape(-1, len(names)))
    striker, normal = np.split(seen.reshape(count, ticks, 6), 2, axis=2)
    swings, reached = windowed(
        scene, latents, np.asarray(splits, np.int64), targets, positions, velocities, striker, normal
    )
    usable = (
        reached
        & (torque < TORQUE_SHARE * np.array(info.torque_limits)).all(1)
        & (np.abs(velocities).max(1) < np.array(info.speed_limits)).all(1)
    )
    return swings, usable


def windowed(
    scene: Scene,
    latents: Array,
    splits: NDArray[np.int64],
    targets: Array,
    positions: Array,
    velocities: Array,
    striker: Array,
    normal: Array,
) -> tuple[Swings, NDArray[np.bool_]]:
    """Cut swings to the windows in which hits may begin.

    Args:
        scene: with the object at its nominal start.
        latents: (n, latent).
        splits: (n,).
        targets: (n, t, j) rad.
        positions: (n, t, j) rad, at all ticks.
        velocities: (n, t, j) rad/s, at all ticks.
        striker: (n, t, 3) m.
        normal: (n, t, 3).

    Returns:
        The swings, and (n,) whether the object is reached early enough for a whole window.
    """
    info = scene.info
    starts = np.tile(np.array(info.start), (len(latents), 1))
    gap = striker_gap(scene, striker, normal, starts)
    ticks = gap.shape[1]
    first = np.clip((gap < 0).argmax(1) - round(WINDOW_BEFORE / info.control_period), 0, None)
    window = round((WINDOW_BEFORE + WINDOW_AFTER) / info.control_period)
    rows = np.minimum(first[:, None] + np.arange(window), ticks - 1)[:, :, None]
    swings = Swings(
        latents=latents,
        splits=splits,
        starts=starts,
        targets=targets,
        positions=np.take_along_axis(positions, rows, 1),
        velocities=np.take_along_axis(velocities, rows, 1),
        first=first.astype(np.int64),
        striker=striker,
        normal=normal,
        poses=positions[:, :: pose_stride(info.control_period)],
    )
    return swings, (gap < 0).any(1) & (first + window < ticks)


def striker_gap(scene: Scene, striker: Array, normal: Array, place: Array) -> Array:
    """(n, t) distance in m between the striking face and an object at `place` (n, 2)."""
    level = normal[:, :, :2] / np.linalg.norm(normal[:, :, :2], axis=2, keepdims=True)
    ahead = ((place[:, None] - striker[:, :, :2]) * level).sum(2)
    return ahead - scene.info.striker_half_thickness - scene.info.object_radius
