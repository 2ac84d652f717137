"""Scales of a rig's recorded motion, from which priors of effects are derived."""

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import actuator_force
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.effect import Joint, RigMotion, SensedChannel

_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_SAMPLES = 500
_SMALLEST = 1e-3  # relative to the largest scale: lower bound


def rig_motion(rig: Rig, segments: Segments, trajectory: Array) -> RigMotion:
    """Scales of the motion along a trajectory.

    Args:
        rig: nominal.
        segments: data.
        trajectory: (S, L, nq + nv + na), such as the recorded one.
    """
    model, inside = rig.model, segments.inside
    x = trajectory[inside]
    q, v = x[:, : model.nq], x[:, model.nq : model.nq + model.nv]
    torque, inertia = _dynamics(model, segments, trajectory)
    control = segments.control()[..., 0, :][inside]
    driven = np.abs(actuator_force(model, x, control))
    largest = np.quantile(driven, 0.999, axis=0) if len(driven) else np.zeros(model.nu)
    speed = _floored(np.sqrt(np.mean(v**2, axis=0)))
    joints = []
    for j in range(model.njnt):
        if model.jnt_type[j] not in _SCALAR:
            continue
        adr, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        travel = float(np.std(q[:, adr]))
        actuators = [
            i
            for i in range(model.nu)
            if model.actuator_trntype[i] == int(mujoco.mjtTrn.mjTRN_JOINT) and model.actuator_trnid[i, 0] == j
        ]
        joints.append(
            Joint(
                name=model.joint(j).name,
                q=adr,
                v=dof,
                unit="N m" if model.jnt_type[j] == _SCALAR[0] else "N",
                actuators=tuple(actuators),
                torque=float(torque[dof]),
                largest=tuple(float(largest[i]) for i in actuators),
                speed=float(speed[dof]),
                travel=max(travel, 1e-3 * max(1.0, travel)),
                middle=float(np.mean(q[:, adr])),
                inertia=float(inertia[dof]),
            )
        )
    free = [
        (int(model.jnt_bodyid[j]), int(model.jnt_dofadr[j]))
        for j in range(model.njnt)
        if model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_FREE)
    ]
    flight = max((float(np.sqrt(np.mean(np.sum(v[:, a : a + 3] ** 2, 1)))) for _, a in free), default=0.0)
    sensed = tuple(
        SensedChannel(c, o.channel, o.quantity, o.part if o.dof is not None else None, o.clock)
        for c, o in enumerate(rig.observations)
    )
    return RigMotion(
        model, tuple(joints), tuple(free), sensed, segments.interval, len(np.unique(segments.episode)), flight
    )


def torque_scale(rig: Rig, segments: Segments, trajectory: Array) -> Array:
    """(nv,) rms generalised force that moves each degree of freedom along a trajectory, N m or N."""
    return _dynamics(rig.model, segments, trajectory)[0]


def _dynamics(model: mujoco.MjModel, segments: Segments, trajectory: Array) -> tuple[Array, Array]:
    """Rms torque by inverse dynamics, gravity included, and mean diagonal of the mass matrix; (nv,) each."""
    nq, nv = model.nq, model.nv
    rate = segments.rate(trajectory[..., nq : nq + nv])
    good = np.argwhere(segments.inside)
    some = good[np.unique(np.linspace(0, len(good) - 1, min(_SAMPLES, len(good))).astype(int))]
    data, full = mujoco.MjData(model), np.zeros((nv, nv))
    torque, inertia = np.zeros(nv), np.zeros(nv)
    for s, t in some:
        data.qpos[:], data.qvel[:] = trajectory[s, t, :nq], trajectory[s, t, nq : nq + nv]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, full)
        torque += (full @ rate[s, t] + data.qfrc_bias) ** 2
        inertia += np.diag(full)
    return _floored(np.sqrt(torque / len(some))), inertia / len(some)


def _floored(scale: Array) -> Array:
    return np.maximum(scale, max(_SMALLEST * float(scale.max(initial=0.0)), 1e-9))
