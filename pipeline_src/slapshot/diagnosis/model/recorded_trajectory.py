"""Initial trajectory for linearisation: the recorded signals, smoothed."""

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from slapshot.arrays import Array
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.tangent import Tangent, angular_velocity

_WINDOW_S = 0.06  # longer than the noise of an encoder, shorter than the motion of a robot


def recorded_trajectory(rig: Rig, segments: Segments) -> Array:
    """States on all nodes, (S, L, nq + nv + na).

    Positions and velocities of joints that are observed, and of bodies with a free joint, follow the record;
    so do rotations of which all four components are observed. Unobserved coordinates rest at the
    model's first keyframe, or at its initial position. Fits move the trajectory towards the model's motion.
    """
    tangent = Tangent(rig.model)
    S, L = segments.shape
    x = np.zeros((S, L, tangent.size))
    x[..., : tangent.nq] = rig.model.key_qpos[0] if rig.model.nkey else rig.model.qpos0
    for columns, q, v in _targets(rig):
        for own in segments.runs():
            inside = segments.inside[own]
            smooth, rate = _smoothed(segments, own, columns)
            if not len(smooth):
                continue
            if len(columns) == 4:
                smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
                rate = angular_velocity(smooth, rate)
            position = np.empty((*inside.shape, len(columns)))
            position[:] = smooth[-1]
            position[inside] = smooth
            velocity = np.zeros((*inside.shape, rate.shape[1]))
            velocity[inside] = rate
            x[own, :, q : q + position.shape[2]] = position
            x[own, :, tangent.nq + v : tangent.nq + v + velocity.shape[2]] = velocity
    return x


def _smoothed(segments: Segments, own: NDArray[np.intp], columns: list[int]) -> tuple[Array, Array]:
    """Smoothed observations of consecutive segments and their rate, (nodes, columns); empty if none."""
    inside, h = segments.inside[own], segments.interval
    value = segments.y[own][:, :, columns][inside]
    late = segments.shift[own][:, :, columns[0]][inside] / h
    there = np.isfinite(value).all(axis=1)
    if there.sum() < 2:
        return np.zeros((0, len(columns))), np.zeros((0, len(columns)))
    known = value[there]
    if len(columns) == 4:
        # Of the two signs of a quaternion the one that is nearer to the one before.
        turns = np.sum(known[1:] * known[:-1], axis=1) < 0
        known[1:] *= np.cumprod(np.where(turns, -1.0, 1.0))[:, None]
    nodes = np.arange(len(value))
    value = np.stack([np.interp(nodes, (nodes + late)[there], part) for part in known.T], axis=1)
    window = min(max(5, round(_WINDOW_S / h) | 1), (len(value) - 1) | 1)
    if window < 5:
        return value, np.gradient(value, h, axis=0)
    smooth = savgol_filter(value, window, 3, axis=0)
    return smooth, savgol_filter(value, window, 3, 1, h, axis=0)


def _targets(rig: Rig) -> list[tuple[list[int], int, int]]:
    """Of all coordinates that are observed: columns of the observations, first index in qpos and in qvel."""
    model, found = rig.model, []
    for column, observation in enumerate(rig.observations):
        if observation.quantity != "position":
            continue
        if observation.dof is not None:
            joint = int(model.dof_jntid[observation.dof])
            found.append(([column], int(model.jnt_qposadr[joint]), observation.dof))
            continue
        body, sensor = _own_joint(rig, column), rig.sensor_of(column)
        if body is not None and model.sensor_type[sensor] == int(mujoco.mjtSensor.mjSENS_FRAMEPOS):
            axis = observation.address - int(model.sensor_adr[sensor])
            found.append(([column], int(model.jnt_qposadr[body]) + axis, int(model.jnt_dofadr[body]) + axis))
    for columns in rig.quaternions:
        turned = _own_joint(rig, columns[0])
        if turned is not None:
            ahead = 3 if model.jnt_type[turned] == int(mujoco.mjtJoint.mjJNT_FREE) else 0
            q, v = int(model.jnt_qposadr[turned]) + ahead, int(model.jnt_dofadr[turned]) + ahead
            found.append((columns, q, v))
    return found


def _own_joint(rig: Rig, column: int) -> int | None:
    """The free joint of the body that a column observes, or the ball joint that it does."""
    model, sensor = rig.model, rig.sensor_of(column)
    target = int(model.sensor_objid[sensor])
    if model.sensor_type[sensor] == int(mujoco.mjtSensor.mjSENS_BALLQUAT):
        return target
    if model.sensor_objtype[sensor] == int(mujoco.mjtObj.mjOBJ_XBODY):
        joint = int(model.body_jntadr[target])
        if joint >= 0 and model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE):
            return joint
    return None
