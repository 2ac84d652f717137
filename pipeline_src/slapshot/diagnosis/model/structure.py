"""Rigs restructured by effects with hidden states, and transfer of trajectories to them."""

from dataclasses import replace

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.sensors import OWN
from slapshot.effects.joints.effect import JointEffect, RigMotion
from slapshot.effects.joints.split import SplitJoint, deflection
from slapshot.recordings.channels import Channel

_STEP_RATE = 1.0  # rad a step


def substeps_for(step: float, fastest: float) -> int:
    """Number of substeps of a time step in s, so that a mode at `fastest` rad/s is simulated accurately.

    Errors of the Runge-Kutta method are small for six or more steps in a period.
    """
    return max(1, int(np.ceil(step * fastest / _STEP_RATE - 1e-9)))


def restructured(rig: Rig, effect: JointEffect, channels: dict[str, Channel]) -> Rig:
    """The rig restructured by an effect."""
    spec = rig.spec.copy()
    spec = effect.restructure(spec)
    _keep_keyframes(spec, rig.model)
    # First-order integrators would need ten times shorter steps for the light and stiff addition.
    spec.option.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    second = deflection(effect.part)
    reads_link = isinstance(effect, SplitJoint) and effect.reads_link
    if reads_link:
        types = {"position": mujoco.mjtSensor.mjSENS_JOINTPOS, "velocity": mujoco.mjtSensor.mjSENS_JOINTVEL}
        for quantity, kind in types.items():
            name = f"{OWN}{quantity}:{second}"
            spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=second)
    new = bind(spec, channels, rig.name, rig.free)
    new = replace(new, controls=rig.controls, longest_step=rig.longest_step)
    if reads_link:
        # The encoder reads the sum of motor and deflection.
        for row, observation in enumerate(new.observations):
            if observation.dof == new.model.joint(effect.part).dofadr[0] and observation.quantity in types:
                sensor = new.model.sensor(f"{OWN}{observation.quantity}:{second}")
                new.reading[row, int(sensor.adr[0])] = 1
    return new


def _keep_keyframes(spec: mujoco.MjSpec, old: mujoco.MjModel) -> None:
    """Keyframes in the order of joints of a restructured model, with added joints where they begin.

    Args:
        spec: of the restructured model, whose keyframes MuJoCo has padded at their ends.
        old: the model before.
    """
    new = spec.copy().compile()
    for key, qpos, qvel in zip(spec.keys, old.key_qpos, old.key_qvel, strict=True):
        own_q, own_v = new.qpos0.copy(), np.zeros(new.nv)
        for j in range(old.njnt):
            to, q, v = new.joint(old.joint(j).name), old.jnt_qposadr[j], old.jnt_dofadr[j]
            own_q[to.qposadr[0] :][: len(to.qpos0)] = qpos[q : q + len(to.qpos0)]
            width = len(new.dof_jntid[new.dof_jntid == to.id])
            own_v[to.dofadr[0] :][:width] = qvel[v : v + width]
        key.qpos, key.qvel = own_q, own_v


def reindexed_motion(of: RigMotion, rig: Rig) -> RigMotion:
    """The scales with the indices of a restructured rig."""
    joints = []
    for joint in of.joints:
        own = rig.model.joint(joint.name)
        joints.append(replace(joint, q=int(own.qposadr[0]), v=int(own.dofadr[0])))
    free = tuple((body, int(rig.model.jnt_dofadr[rig.model.body_jntadr[body]])) for body, _ in of.free_bodies)
    return replace(of, model=rig.model, joints=tuple(joints), free_bodies=free)


def transferred_trajectory(
    old: Rig, new: Rig, effect: JointEffect | None, segments: Segments, trajectory: Array
) -> Array:
    """Transfer a trajectory of the nominal rig to a restructured one, as initial guess.

    Args:
        old: nominal.
        new: restructured.
        effect: that restructured it, for its deflection under load; None for none.
        segments: data.
        trajectory: (S, L, nq + nv + na) of the old rig.
    """
    a, b = old.model, new.model
    out = np.zeros((*trajectory.shape[:2], b.nq + b.nv + b.na))
    out[..., : b.nq] = b.qpos0
    for j in range(a.njnt):
        other = b.joint(a.joint(j).name)
        width_q = _width(a, j)
        width_v = {7: 6, 4: 3, 1: 1}[width_q]
        q, v = a.jnt_qposadr[j], a.jnt_dofadr[j]
        to_q, to_v = int(other.qposadr[0]), int(other.dofadr[0])
        out[..., to_q : to_q + width_q] = trajectory[..., q : q + width_q]
        out[..., b.nq + to_v : b.nq + to_v + width_v] = trajectory[..., a.nq + v : a.nq + v + width_v]
    out[..., b.nq + b.nv :] = trajectory[..., a.nq + a.nv :]
    if isinstance(effect, SplitJoint):
        joint = a.joint(effect.part)
        load = _inverse_dynamics(a, segments, trajectory)[..., int(joint.dofadr[0])]
        offset = effect.static_deflection(load)
        rate = np.gradient(offset, segments.interval, axis=1)
        own, motor = b.joint(deflection(effect.part)), b.joint(effect.part)
        out[..., int(own.qposadr[0])] = offset
        out[..., b.nq + int(own.dofadr[0])] = rate
        if effect.reads_link:
            out[..., int(motor.qposadr[0])] -= offset
            out[..., b.nq + int(motor.dofadr[0])] -= rate
    return out


def _width(model: mujoco.MjModel, joint: int) -> int:
    kind = int(model.jnt_type[joint])
    return {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}.get(kind, 1)


def _inverse_dynamics(model: mujoco.MjModel, segments: Segments, trajectory: Array) -> Array:
    """(S, L, nv) generalised force for the motion of the links by inverse dynamics, without rotors."""
    S, L = segments.shape
    nq, nv = model.nq, model.nv
    rate = np.gradient(trajectory[..., nq : nq + nv], segments.interval, axis=1)
    data, full = mujoco.MjData(model), np.zeros((nv, nv))
    out = np.zeros((S, L, nv))
    for s in range(S):
        for t in range(L):
            data.qpos[:], data.qvel[:] = trajectory[s, t, :nq], trajectory[s, t, nq : nq + nv]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_fullM(model, data, full)
            out[s, t] = full @ rate[s, t] - model.dof_armature * rate[s, t] + data.qfrc_bias
    return out
