"""States of a MuJoCo model and their tangent space.

A state is x = (qpos, qvel, act) of length nq + nv + na; a small change of it is δ of length 2 nv + na, whose
first nv entries are a rotation vector where a joint holds a quaternion. All functions take many states at
once.
"""

import mujoco
import numpy as np

from slapshot.arrays import Array

_QUATERNION_AT = {mujoco.mjtJoint.mjJNT_FREE: (3, 3), mujoco.mjtJoint.mjJNT_BALL: (0, 0)}


class Tangent:
    """Addition and subtraction of states.

    Attributes:
        nq, nv, na: sizes of the model.
        size: length of a state.
        dim: length of a change.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.nq, self.nv, self.na = model.nq, model.nv, model.na
        self.size, self.dim = model.nq + model.nv + model.na, 2 * model.nv + model.na
        # (first index in qpos, first index in qvel) of each quaternion
        self._quaternions: list[tuple[int, int]] = []
        scalar_q, scalar_v = np.ones(model.nq, bool), np.ones(model.nv, bool)
        for j in range(model.njnt):
            offset = _QUATERNION_AT.get(mujoco.mjtJoint(model.jnt_type[j]))
            if offset is not None:
                q, v = model.jnt_qposadr[j] + offset[0], model.jnt_dofadr[j] + offset[1]
                self._quaternions.append((int(q), int(v)))
                scalar_q[q : q + 4], scalar_v[v : v + 3] = False, False
        self._q, self._v = np.flatnonzero(scalar_q), np.flatnonzero(scalar_v)

    def add(self, x: Array, delta: Array) -> Array:
        """States moved by changes.

        Args:
            x: (..., size).
            delta: (..., dim).

        Returns:
            (..., size).
        """
        moved = np.empty((*np.broadcast_shapes(x.shape[:-1], delta.shape[:-1]), self.size))
        moved[...] = x
        moved[..., self._q] += delta[..., self._v]
        moved[..., self.nq :] += delta[..., self.nv :]
        for q, v in self._quaternions:
            turned = _product(moved[..., q : q + 4], _exponential(delta[..., v : v + 3]))
            moved[..., q : q + 4] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
        return moved

    def subtract(self, a: Array, b: Array) -> Array:
        """The change that leads from states b to states a, so that adding it to b gives a.

        Args:
            a: (..., size).
            b: (..., size).

        Returns:
            (..., dim).
        """
        delta = np.empty((*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), self.dim))
        delta[..., self._v] = a[..., self._q] - b[..., self._q]
        delta[..., self.nv :] = a[..., self.nq :] - b[..., self.nq :]
        for q, v in self._quaternions:
            conjugate = b[..., q : q + 4] * np.array([1.0, -1, -1, -1])
            delta[..., v : v + 3] = _logarithm(_product(conjugate, a[..., q : q + 4]))
        return delta


def angular_velocity(q: Array, rate: Array) -> Array:
    """Angular velocity in the turned frame, as qvel has it, of a unit quaternion and its derivative.

    Args:
        q: (..., 4).
        rate: (..., 4) in 1/s.

    Returns:
        (..., 3) rad/s.
    """
    return 2 * _product(q * np.array([1.0, -1, -1, -1]), rate)[..., 1:]


def _product(p: Array, q: Array) -> Array:
    w, x, y, z = np.moveaxis(p, -1, 0)
    a, b, c, d = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=-1,
    )


def _exponential(rotation: Array) -> Array:
    angle = np.linalg.norm(rotation, axis=-1, keepdims=True)
    # sin(a / 2) / a, which is 1/2 at rest
    factor = 0.5 * np.sinc(angle / (2 * np.pi))
    return np.concatenate([np.cos(angle / 2), factor * rotation], axis=-1)


def _logarithm(q: Array) -> Array:
    q = np.where(q[..., :1] < 0, -q, q)  # the shorter way round
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, q[..., :1])
    factor = np.where(sine > 1e-12, 2 * half / np.maximum(sine, 1e-300), 2.0)
    return factor * q[..., 1:]
