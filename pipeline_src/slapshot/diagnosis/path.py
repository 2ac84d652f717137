"""The path that segments are linearised about: at first what was recorded, smoothed a little."""

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from slapshot.diagnosis.rig import Rig
from slapshot.diagnosis.segments import Segments
from slapshot.diagnosis.tangent import Tangent

Array = NDArray[np.float64]

_WINDOW_S = 0.06  # longer than the noise of an encoder, shorter than the motion of a robot


def recorded_path(rig: Rig, segments: Segments) -> Array:
    """States on all nodes, (S, L, nq + nv + na).

    Positions and velocities of joints that are observed, and of bodies with a free joint, follow the record;
    what is not observed rests at the model's initial position. Fits move the path to where the model goes.
    """
    tangent = Tangent(rig.model)
    S, L = segments.shape
    x = np.zeros((S, L, tangent.size))
    x[..., : tangent.nq] = rig.model.qpos0
    width = max(5, round(_WINDOW_S / segments.interval) | 1)
    for column, q, v in _targets(rig):
        for episode in np.unique(segments.episode):
            own = np.flatnonzero(segments.episode == episode)
            inside = segments.inside[own]
            value = segments.y[own, :, column][inside]
            there = np.isfinite(value)
            if there.sum() < 2:
                continue
            nodes = np.arange(len(value))
            late = segments.shift[own, :, column][inside] / segments.interval
            value = np.interp(nodes, (nodes + late)[there], value[there])
            window = min(width, (len(value) - 1) | 1)
            if window >= 5:
                smooth = savgol_filter(value, window, 3)
                rate = savgol_filter(value, window, 3, 1, segments.interval)
            else:
                smooth, rate = value, np.gradient(value, segments.interval)
            position = np.full(inside.shape, smooth[-1])
            position[inside] = smooth
            velocity = np.zeros(inside.shape)
            velocity[inside] = rate
            x[own, :, q] = position
            x[own, :, tangent.nq + v] = velocity
    return x


def _targets(rig: Rig) -> list[tuple[int, int, int]]:
    """(column of the observations, index in qpos, index in qvel) of every coordinate that is observed."""
    model, found = rig.model, []
    for column, observation in enumerate(rig.observations):
        if observation.quantity != "position":
            continue
        if observation.dof is not None:
            joint = int(model.dof_jntid[observation.dof])
            found.append((column, int(model.jnt_qposadr[joint]), observation.dof))
            continue
        sensor = int(np.flatnonzero(model.sensor_adr <= observation.address)[-1])
        kind, target = int(model.sensor_objtype[sensor]), int(model.sensor_objid[sensor])
        bodies = (int(mujoco.mjtObj.mjOBJ_XBODY), int(mujoco.mjtObj.mjOBJ_BODY))
        if model.sensor_type[sensor] == int(mujoco.mjtSensor.mjSENS_FRAMEPOS) and kind in bodies:
            joint = int(model.body_jntadr[target])
            if joint >= 0 and model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE):
                axis = observation.address - int(model.sensor_adr[sensor])
                found.append(
                    (column, int(model.jnt_qposadr[joint]) + axis, int(model.jnt_dofadr[joint]) + axis)
                )
    return found
