"""Initial trajectory for linearisation: the recorded signals, smoothed."""

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.smoothed_readings import smoothed
from slapshot.diagnosis.model.tangent import Tangent, angular_velocity
from slapshot.diagnosis.model.unseen_joints import (
    Loops,
    find_first_angles,
    integrate_velocity,
    is_place,
    observed_point,
    solve_positions,
    unseen_joints,
)

_FILTERS = int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT)
_FASTEST_FILTER_S = 1e-9


def recorded_trajectory(rig: Rig, segments: Segments) -> Array:
    """States on all nodes, (S, L, nq + nv + na).

    Positions and velocities of joints that are observed, and of bodies with a free joint, follow the record;
    so do rotations of which all four components are observed. Joints that are seen by their velocity alone
    follow its integral; those that are seen by other places of sites or bodies alone, or behind a gear, or
    belong to a loop that equality constraints close, are found by inverse kinematics. Other coordinates rest
    at the model's first keyframe, or at its initial position. Activations of filters follow the controls.
    Fits move the trajectory towards the model's motion.
    """
    tangent = Tangent(rig.model)
    S, L = segments.shape
    x = np.zeros((S, L, tangent.size))
    x[..., : tangent.nq] = rig.model.key_qpos[0] if rig.model.nkey else rig.model.qpos0
    _filter_controls(rig.model, segments, x[..., tangent.nq + tangent.nv :])
    targets = _targets(rig)
    for columns, q, v in targets:
        for own in segments.runs():
            inside = segments.inside[own]
            smooth, rate = smoothed(segments, own, columns)
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
    direct = {column for columns, *_ in targets for column in columns}
    places = [c for c in range(len(rig.observations)) if is_place(rig, c) and c not in direct]
    # A quaternion's degrees of freedom are three.
    seen = {v + axis for columns, _, v in targets for axis in range(3 if len(columns) == 4 else 1)}
    unseen = unseen_joints(rig, seen, places)
    turned = [v for v in unseen if integrate_velocity(rig, segments, x, v)]
    unseen = [v for v in unseen if v not in turned]
    if unseen and (places or Loops(rig.model)):
        solve_positions(rig, segments, x, unseen, places)
    for v in turned:
        if rig.model.jnt_type[rig.model.dof_jntid[v]] == int(mujoco.mjtJoint.mjJNT_HINGE):
            find_first_angles(rig, segments, x, v)
    return x


def _filter_controls(model: mujoco.MjModel, segments: Segments, act: Array) -> None:
    """Write the activations (S, L, na) of first-order filters, which begin where their controls do."""
    control = segments.control().mean(axis=2)
    for i in np.flatnonzero(np.isin(model.actuator_dyntype, _FILTERS) & (model.actuator_actnum == 1)):
        share = -np.expm1(-segments.interval / max(float(model.actuator_dynprm[i, 0]), _FASTEST_FILTER_S))
        limits = model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else (-np.inf, np.inf)
        bounds = model.actuator_actrange[i] if model.actuator_actlimited[i] else (-np.inf, np.inf)
        for own in segments.runs():
            u = np.clip(control[own, :, i].reshape(-1), *limits)
            value, along = float(np.clip(u[0], *bounds)), np.empty(len(u))
            for t, target in enumerate(u):
                along[t] = value
                value = float(np.clip(value + share * (target - value), *bounds))
            act[own, :, model.actuator_actadr[i]] = along.reshape(len(own), -1)


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
    """The free joint whose own frame a column observes, or the ball joint that it does."""
    model, sensor = rig.model, rig.sensor_of(column)
    if model.sensor_type[sensor] == int(mujoco.mjtSensor.mjSENS_BALLQUAT):
        return int(model.sensor_objid[sensor])
    point = observed_point(model, sensor)
    if point is None:
        return None
    joint = int(model.body_jntadr[point.body])
    is_free = joint >= 0 and model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE)
    is_quaternion = model.sensor_type[sensor] == int(mujoco.mjtSensor.mjSENS_FRAMEQUAT)
    own = point.is_aligned if is_quaternion else point.is_origin
    return joint if is_free and own else None
