"""Detects when an object has left the striker for good, from the executed trajectory of the arm."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.lab.executed_trajectory import ExecutedPath
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion

LOOK_AHEAD = 0.005  # s, between the future positions of the blade that are checked
PARTED = 0.01  # m, clearance at which the object is released; the blade's vibration is smaller


class StrikerPath:
    """The path of the striker if the arm follows its executed trajectory exactly."""

    def __init__(
        self, scene: Scene, model: mujoco.MjModel, arm: NDArray[np.int64], path: ExecutedPath
    ) -> None:
        self._reach = scene.info.striker_half_thickness, scene.info.object_radius
        self._times, positions = path.led(LOOK_AHEAD, scene.info.control_period)
        data, site = mujoco.MjData(model), model.site(scene.info.striker_site).id
        self._places = np.empty((len(positions), 2))
        self._normals = np.empty((len(positions), 2))
        for i, q in enumerate(positions):
            data.qpos[arm] = q
            mujoco.mj_kinematics(model, data)
            self._places[i] = data.site_xpos[site, :2]
            normal = data.site_xmat[site].reshape(3, 3)[:2, 0]
            self._normals[i] = normal / np.linalg.norm(normal)

    def misses(self, state: Array, now: float, hardest: float) -> bool:
        """Whether the striker will not touch the object again, even at its largest deceleration.

        The object has the state `state` at time `now` (s). With speed v and the deceleration `hardest`
        (m/s^2) it moves by v t - hardest t^2 / 2 within t <= v / hardest.
        """
        speed = float(np.hypot(state[3], state[4]))
        coming = np.append(self._times[self._times > now], max(now, self._times[-1]))
        t = np.minimum(coming - now, speed / hardest)
        moved = np.outer(t - hardest * t**2 / (2 * speed), state[3:5])
        rows = np.minimum(np.searchsorted(self._times, coming), len(self._places) - 1)
        ahead = ((state[:2] + moved - self._places[rows]) * self._normals[rows]).sum(1)
        half_thickness, radius = self._reach
        return bool((ahead - half_thickness - radius).min() > PARTED)

    def time_at(self, place: Array) -> float:
        """Time in s at which the striker first reaches an object at `place` (2,), or is nearest to it."""
        return float(self._times[self._first(place)])

    def speed_at(self, place: Array) -> float:
        """Speed of the striker in m/s at that time."""
        near = self._first(place)
        return float(np.linalg.norm(self._places[near] - self._places[near - 1]) / LOOK_AHEAD)

    def _first(self, place: Array) -> int:
        gap = ((place - self._places) * self._normals).sum(1) - sum(self._reach)
        near = int((gap < 0).argmax()) if (gap < 0).any() else int(np.abs(gap).argmin())
        return min(max(near, 1), len(gap) - 1)


def nearest_pose(scene: Scene, motion: Motion) -> Array:
    """(joints,) rad, the pose of a commanded motion in which the striker reaches the object's start."""
    model = scene.compile()
    path = ExecutedPath(motion, 1.0, np.zeros(len(scene.info.joints)))
    striker = StrikerPath(scene, model, scene.layout.arm_q, path)
    time = striker.time_at(np.array(scene.info.start))
    return motion.position(np.array([time]))[0]
