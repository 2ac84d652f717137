"""Inverse kinematics of an arm for many poses at once.

The method is that of dm_control.utils.inverse_kinematics, by Newton steps with a damped pseudoinverse of the
Jacobian (Buss 2004), which solves one pose at a time; tests/trajectories holds both against each other.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.trajectories.kinematics import Kinematics, matrix

_TOLERANCE = 1e-6  # distance in m plus angle in rad
_DAMPING, _FAR = 3e-2, 0.1  # damping while the error is larger than this; then next to none
_NEXT_TO_NONE = 1e-12  # keeps singular poses finite
_LONGEST_STEP = 2.0  # rad
_SLOWEST = 20.0  # error over step, above which the search is stuck
_MOST_STEPS = 100


class InverseKinematics:
    """Joint positions that bring a site to given poses.

    Args:
        model: the model.
        site: id of the site.
        joints: names of hinges that move it, one on each body.

    Raises:
        InputError: a joint is not a hinge, or shares its body with another.
    """

    def __init__(self, model: mujoco.MjModel, site: int, joints: list[str]) -> None:
        bodies = [int(model.joint(name).bodyid[0]) for name in joints]
        hinges = all(model.joint(name).type[0] == mujoco.mjtJoint.mjJNT_HINGE for name in joints)
        if not hinges or len(set(bodies)) < len(bodies):
            raise InputError("scene: the joints of an arm must be hinges, one on each body")
        body = int(model.site_bodyid[site])
        self._kinematics = Kinematics(model, [body, *bodies], joints)
        self._row, self._rows = self._kinematics.row(body), [self._kinematics.row(b) for b in bodies]
        self._place, self._turn = model.site_pos[site], matrix(model.site_quat[site])
        self._axes = np.array([model.joint(name).axis for name in joints])
        self._anchors = np.array([model.joint(name).pos for name in joints])

    def solve(self, start: Array, places: Array, turns: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Solve for n poses, each from its own start.

        Args:
            start: (n, joints) rad.
            places: (n, 3) positions of the site, m.
            turns: (n, 3, 3) rotations of the site.

        Returns:
            (n, joints) positions in rad, and whether each pose was reached, (n,).
        """
        positions, reached = np.array(start), np.zeros(len(start), bool)
        left = np.arange(len(start))
        for _ in range(_MOST_STEPS):
            error, jacobian = self._linearised(positions[left], places[left], turns[left])
            size = np.linalg.norm(error[:, :3], axis=1) + np.linalg.norm(error[:, 3:], axis=1)
            close = size < _TOLERANCE
            reached[left[close]] = True
            step = _newton_steps(jacobian, error, np.where(size > _FAR, _DAMPING, _NEXT_TO_NONE))
            length = np.linalg.norm(step, axis=1)
            moving = ~close & (size <= _SLOWEST * length)
            step *= np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300))[:, None]
            left, step = left[moving], step[moving]
            if not len(left):
                break
            positions[left] += step
        return positions, reached

    def _linearised(self, positions: Array, places: Array, turns: Array) -> tuple[Array, Array]:
        """Errors (n, 6) in m and rad, and the Jacobian of the site's pose (n, 6, joints)."""
        origins, rotations = self._kinematics.poses(positions)
        here = origins[:, self._row] + rotations[:, self._row] @ self._place
        turned = rotations[:, self._row] @ self._turn
        about = Rotation.from_matrix(turns @ turned.transpose(0, 2, 1)).as_rotvec()
        axes = np.einsum("njab,jb->nja", rotations[:, self._rows], self._axes)
        anchors = origins[:, self._rows] + np.einsum("njab,jb->nja", rotations[:, self._rows], self._anchors)
        moved = np.cross(axes, here[:, None] - anchors)
        jacobian = np.concatenate([moved, axes], axis=2).transpose(0, 2, 1)
        return np.concatenate([places - here, about], axis=1), jacobian


def _newton_steps(jacobian: Array, error: Array, damping: Array) -> Array:
    """Least-squares steps with a penalty on their length; the shortest ones where that is next to nothing.

    Of J'J + d 1 and JJ' + d 1, which give the same steps, the second is smaller and regular where d is 0.
    """
    transposed = jacobian.transpose(0, 2, 1)
    normal = jacobian @ transposed + damping[:, None, None] * np.eye(6)
    return np.asarray((transposed @ np.linalg.solve(normal, error[..., None]))[..., 0])
