"""Forward kinematics of an arm for many joint positions at once.

MuJoCo computes one pose at a time, and a call from Python takes several times as long as the computation.
This module repeats what mj_kinematics does for each body: from the parent's frame to the body's, then joint
by joint.
"""

import math

import mujoco
import numpy as np
from numba import njit

from slapshot.arrays import Array
from slapshot.errors import InputError

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


class Kinematics:
    """Kinematics of some bodies of a model and their ancestors; other joints stay at their references."""

    def __init__(self, model: mujoco.MjModel, bodies: list[int], joints: list[str]) -> None:
        """Copy the constants of the model.

        Args:
            model: the model.
            bodies: ids of the bodies whose poses are needed.
            joints: joints whose positions will be given, in that order.

        Raises:
            InputError: a body or its ancestor has a joint that is neither a hinge nor a slide.
        """
        wanted = set(bodies)
        for body in sorted(bodies):
            while (body := int(model.body_parentid[body])) != 0:
                wanted.add(body)
        self._rows = {body: row for row, body in enumerate(sorted(wanted - {0}))}
        known = list(self._rows)
        self._parents = np.array([self._rows.get(int(model.body_parentid[b]), -1) for b in known])
        self._places = model.body_pos[known]
        self._turns = np.array([matrix(model.body_quat[b]) for b in known])
        columns = {model.joint(name).id: column for column, name in enumerate(joints)}
        mine = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in self._rows]
        if not set(model.jnt_type[mine].tolist()) <= {_HINGE, _SLIDE}:
            raise InputError("scene: the striker hangs on a joint that is neither a hinge nor a slide")
        self._moves = np.array(
            [
                [self._rows[int(model.jnt_bodyid[j])], columns.get(j, -1), model.jnt_type[j] == _HINGE]
                for j in mine
            ],
            np.int64,
        ).reshape(-1, 3)
        self._axes, self._anchors = model.jnt_axis[mine], model.jnt_pos[mine]
        self._zeros = np.array([model.qpos0[model.joint(name).qposadr[0]] for name in joints])

    def row(self, body: int) -> int:
        """Index of a body in the arrays that `poses` returns."""
        return self._rows[body]

    def poses(self, positions: Array) -> tuple[Array, Array]:
        """Positions (n, bodies, 3) in m and rotations (n, bodies, 3, 3) for joints (n, j) in rad or m."""
        moved = np.ascontiguousarray(positions - self._zeros, np.float64)
        places = np.empty((len(moved), len(self._rows), 3))
        turns = np.empty((len(moved), len(self._rows), 3, 3))
        _follow(
            moved, self._parents, self._places, self._turns, self._moves, self._axes, self._anchors,
            places, turns,
        )  # fmt: skip
        return places, turns


def site_poses(model: mujoco.MjModel, site: int, joints: list[str], positions: Array) -> Array:
    """(n, 6) position in m and x axis of a site for joint positions (n, j) in rad or m; see Kinematics."""
    body = int(model.site_bodyid[site])
    kinematics = Kinematics(model, [body], joints)
    places, turns = kinematics.poses(positions)
    place, turn = places[:, kinematics.row(body)], turns[:, kinematics.row(body)]
    axis = turn @ matrix(model.site_quat[site])[:, 0]
    return np.concatenate([place + turn @ model.site_pos[site], axis], axis=1)


def matrix(quaternion: Array) -> Array:
    """(3, 3) rotation matrix of a quaternion w, x, y, z."""
    found = np.empty(9)
    mujoco.mju_quat2Mat(found, quaternion)
    return found.reshape(3, 3)


@njit(cache=True)
def _follow(moved, parents, offsets, turns, moves, axes, anchors, places, rotations):  # type: ignore[no-untyped-def]
    # Arrays are allocated outside the loops, because allocation would take longer than the computation.
    start, about, turned = np.eye(3), np.empty((3, 3)), np.empty((3, 3))
    origin = np.zeros(3)
    for i in range(len(moved)):
        joint = 0
        for k in range(len(parents)):
            parent = parents[k]
            place, rotation = places[i, k], rotations[i, k]
            before = rotations[i, parent] if parent >= 0 else start
            place[:] = places[i, parent] if parent >= 0 else origin
            _add(place, before, offsets[k], 1.0)
            _multiply(before, turns[k], rotation)
            while joint < len(moves) and moves[joint, 0] == k:
                by = moved[i, moves[joint, 1]] if moves[joint, 1] >= 0 else 0.0
                if moves[joint, 2]:
                    _add(place, rotation, anchors[joint], 1.0)
                    _turn(axes[joint], by, about)
                    _multiply(rotation, about, turned)
                    rotation[:] = turned
                    _add(place, rotation, anchors[joint], -1.0)
                else:
                    _add(place, rotation, axes[joint], by)
                joint += 1


@njit(cache=True)
def _add(place, rotation, v, factor):  # type: ignore[no-untyped-def]
    """Add `factor` times the rotated v to a position, in place."""
    for i in range(3):
        place[i] += factor * (rotation[i, 0] * v[0] + rotation[i, 1] * v[1] + rotation[i, 2] * v[2])


@njit(cache=True)
def _multiply(a, b, found):  # type: ignore[no-untyped-def]
    for i in range(3):
        for j in range(3):
            found[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def _turn(axis, angle, found):  # type: ignore[no-untyped-def]
    """Fill `found` with the rotation about a unit axis, by Rodrigues' formula."""
    x, y, z = axis
    c, s = math.cos(angle), math.sin(angle)
    u = 1 - c
    found[0, 0], found[0, 1], found[0, 2] = c + u * x * x, u * x * y - s * z, u * x * z + s * y
    found[1, 0], found[1, 1], found[1, 2] = u * x * y + s * z, c + u * y * y, u * y * z - s * x
    found[2, 0], found[2, 1], found[2, 2] = u * x * z - s * y, u * y * z + s * x, c + u * z * z
