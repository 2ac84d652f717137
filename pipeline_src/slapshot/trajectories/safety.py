"""Is a trajectory safe to execute? Checked before anything moves; what is unsafe is refused."""

from dataclasses import dataclass

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion

JOINT_MARGIN = np.deg2rad(2.0)  # rad, to a joint's end stop
SPEED_SHARE = 0.95  # of a joint's speed limit
MIN_CLEARANCE = 0.002  # m, of arm and stick over the board
# rad/s^2: three times what the demonstrations need; a decoded kink exceeds it.
MAX_ACCELERATION = 60.0
_CHECKS = 81  # times at which a trajectory is looked at, every 10 ms of 0.8 s


@dataclass(frozen=True)
class SafetyReport:
    """What the check found; `reason` is empty for a safe trajectory.

    Attributes:
        reason: the first limit that is broken, in words.
        speed_share: largest joint speed over its limit.
        clearance: least height in m over the board.
        acceleration: largest joint acceleration in rad/s^2.
    """

    reason: str
    speed_share: float
    clearance: float
    acceleration: float

    @property
    def safe(self) -> bool:
        """True if nothing is broken."""
        return not self.reason


class SafetyCheck:
    """Checks motions of one scene's arm without simulating them."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._model = scene.compile()
        self._data = mujoco.MjData(self._model)
        self._geoms = [self._model.geom(name).id for name in scene.info.clearance_geoms]

    def report(self, motion: Motion) -> SafetyReport:
        """Joint ranges, speeds, smoothness and clearance over the whole motion."""
        layout, info = self._scene.layout, self._scene.info
        times = np.linspace(0, motion.duration, _CHECKS)
        positions = motion.position(times)
        share = np.abs(motion.velocity(times)).max(0) / np.array(info.speed_limits)
        acceleration = np.abs(motion.acceleration(times)).max(0)
        clearance = self._clearance(positions)
        inside = (positions > layout.joint_low + JOINT_MARGIN) & (
            positions < layout.joint_high - JOINT_MARGIN
        )
        reason = ""
        if not np.isfinite(positions).all():
            reason = "not finite"
        elif not inside.all():
            reason = f"joint {info.joints[int(np.argmin(inside.all(0)))]} leaves its range"
        elif share.max() > SPEED_SHARE:
            reason = f"joint {info.joints[int(share.argmax())]} is too fast"
        elif acceleration.max() > MAX_ACCELERATION:
            reason = f"joint {info.joints[int(acceleration.argmax())]} is not smooth"
        elif clearance < MIN_CLEARANCE:
            reason = "too close to the board"
        return SafetyReport(reason, float(share.max()), clearance, float(acceleration.max()))

    def _clearance(self, positions: Array) -> float:
        """Least height over z = 0 of the scene's clearance geoms."""
        lowest = np.inf
        for q in positions:
            self._data.qpos[self._scene.layout.arm_q] = q
            mujoco.mj_kinematics(self._model, self._data)
            for geom in self._geoms:
                rotation = self._data.geom_xmat[geom].reshape(3, 3)
                drop = _extent_down(
                    int(self._model.geom_type[geom]), self._model.geom_size[geom], rotation[2]
                )
                lowest = min(lowest, float(self._data.geom_xpos[geom][2]) - drop)
        return lowest


def _extent_down(kind: int, size: Array, z_row: Array) -> float:
    """How far a geom reaches below its centre, m; `z_row` is the third row of its rotation."""
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return float(size[0] + size[1] * abs(z_row[2]))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return float(size[0] * np.hypot(z_row[0], z_row[1]) + size[1] * abs(z_row[2]))
    return float(np.abs(z_row) @ size)
