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
    solve_positions,
    unseen_joints,
)


def recorded_trajectory(rig: Rig, segments: Segments) -> Array:
    """States on all nodes, (S, L, nq + nv + na).

    Positions and velocities of joints that are observed, and of bodies with a free joint, follow the record;
    so do rotations of which all four components are observed. Joints that are seen by their velocity alone
    follow its integral; those that are seen by places of sites or bodies alone, or belong to a loop that
    equality constraints close, are found by inverse kinematics. Other coordinates rest at the model's first
    keyframe, or at its initial position. Fits move the trajectory towards the model's motion.
    """
    tangent = Tangent(rig.model)
    S, L = segments.shape
    x = np.zeros((S, L, tangent.size))
    x[..., : tangent.nq] = rig.model.key_qpos[0] if rig.model.nkey else rig.model.qpos0
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
    unseen = unseen_joints(rig, {v for _, _, v in targets})
    turned = [v for v in unseen if integrate_velocity(rig, segments, x, v)]
    unseen = [v for v in unseen if v not in turned]
    direct = {column for columns, *_ in targets for column in columns}
    places = [c for c, o in enumerate(rig.observations) if is_place(rig, c) and c not in direct]
    if unseen and (places or Loops(rig.model)):
        solve_positions(rig, segments, x, unseen, places)
    for v in turned:
        if rig.model.jnt_type[rig.model.dof_jntid[v]] == int(mujoco.mjtJoint.mjJNT_HINGE):
            find_first_angles(rig, segments, x, v)
    return x


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
