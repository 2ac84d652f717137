"""Safety check of trajectories before they are executed; unsafe ones are rejected."""

from dataclasses import dataclass

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene
from slapshot.trajectories.kinematics import Kinematics, matrix
from slapshot.trajectories.motion import Motion

JOINT_MARGIN = np.deg2rad(2.0)  # rad, distance to a joint's limits
SPEED_SHARE = 0.95  # of a joint's speed limit
MIN_CLEARANCE = 0.002  # m, of arm and stick above the board
# rad/s^2, three times what the demonstrations need; a kink in a decoded trajectory exceeds it.
MAX_ACCELERATION = 60.0
_CHECKS = 81  # times at which a trajectory is checked: every 10 ms for a duration of 0.8 s


@dataclass(frozen=True)
class SafetyReport:
    """Result of the check; `reason` is empty for a safe trajectory.

    Attributes:
        reason: description of the first limit that is violated.
        speed_share: largest ratio of a joint speed to its limit.
        clearance: smallest height in m above the board.
        acceleration: largest joint acceleration in rad/s^2.
    """

    reason: str
    speed_share: float
    clearance: float
    acceleration: float

    @property
    def safe(self) -> bool:
        """True if no limit is violated."""
        return not self.reason


class SafetyCheck:
    """Checks motions of one scene's arm without simulating them."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._model = model = scene.compile()
        self._geoms = [model.geom(name).id for name in scene.info.clearance_geoms]
        bodies = [int(model.geom_bodyid[geom]) for geom in self._geoms]
        self._kinematics = Kinematics(model, bodies, list(scene.info.joints))

    def report(self, motion: Motion) -> SafetyReport:
        """Check joint ranges, speeds, accelerations and clearance over the whole motion."""
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
        """Smallest height in m above z = 0 of the scene's clearance geoms."""
        model, lowest = self._model, np.inf
        places, turns = self._kinematics.poses(positions)
        for geom in self._geoms:
            body = self._kinematics.row(int(model.geom_bodyid[geom]))
            z_rows = turns[:, body, 2] @ matrix(model.geom_quat[geom])
            heights = places[:, body, 2] + turns[:, body, 2] @ model.geom_pos[geom]
            drops = _extent_down(int(model.geom_type[geom]), model.geom_size[geom], z_rows)
            lowest = min(lowest, float((heights - drops).min()))
        return lowest


def _extent_down(kind: int, size: Array, z_rows: Array) -> Array:
    """(n,) m, extent of a geom below its centre; `z_rows` (n, 3): third rows of its rotations."""
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.full(len(z_rows), size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return size[0] + size[1] * np.abs(z_rows[:, 2])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return size[0] * np.hypot(z_rows[:, 0], z_rows[:, 1]) + size[1] * np.abs(z_rows[:, 2])
    return np.abs(z_rows) @ size
