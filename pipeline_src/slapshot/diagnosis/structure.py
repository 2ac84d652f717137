"""Rigs restructured by effects that have a state of their own, and paths brought over to them."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.rig import Rig, bind
from slapshot.diagnosis.segments import Segments
from slapshot.diagnosis.sensors import OWN
from slapshot.effects.joints.effect import JointEffect, Situation
from slapshot.effects.joints.split import SplitJoint, deflection
from slapshot.recordings.channels import Channel

_STEP_RATE = 1.0  # rad a step


def steps_in(step: float, fastest: float) -> int:
    """In how many steps to divide a time step in s, so that what moves at some rad/s is simulated truly.

    The method is Runge and Kutta's, whose errors are small where a vibration takes six steps or more.
    """
    return max(1, int(np.ceil(step * fastest / _STEP_RATE - 1e-9)))


def restructured(rig: Rig, effect: JointEffect, channels: dict[str, Channel]) -> Rig:
    """The rig with what an effect adds to its model."""
    spec = rig.spec.copy()
    spec = effect.restructure(spec)
    # Of first order, others need steps ten times as short for what is added, which is light and stiff.
    spec.option.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    second = deflection(effect.part)
    reads_link = isinstance(effect, SplitJoint) and effect.reads_link
    if reads_link:
        types = {"position": mujoco.mjtSensor.mjSENS_JOINTPOS, "velocity": mujoco.mjtSensor.mjSENS_JOINTVEL}
        for quantity, kind in types.items():
            name = f"{OWN}{quantity}:{second}"
            spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=second)
    new = replace(bind(spec, channels, rig.name, rig.free), controls=rig.controls)
    if reads_link:
        # The encoder sees motor and deflection together.
        for row, observation in enumerate(new.observations):
            if observation.part == effect.part and observation.quantity in types:
                sensor = new.model.sensor(f"{OWN}{observation.quantity}:{second}")
                new.reading[row, int(sensor.adr[0])] = 1
    return new


def moved_situation(of: Situation, rig: Rig) -> Situation:
    """The same scales, with the indices of a restructured rig."""
    joints = []
    for joint in of.joints:
        own = rig.model.joint(joint.name)
        joints.append(replace(joint, q=int(own.qposadr[0]), v=int(own.dofadr[0])))
    free = tuple((body, int(rig.model.jnt_dofadr[rig.model.body_jntadr[body]])) for body, _ in of.free_bodies)
    return replace(of, model=rig.model, joints=tuple(joints), free_bodies=free)


def moved_path(old: Rig, new: Rig, effect: JointEffect, segments: Segments, path: Array) -> Array:
    """A path of the nominal rig as a first path of a restructured one.

    Args:
        old: nominal.
        new: restructured.
        effect: that restructured it.
        segments: data.
        path: (S, L, nq + nv + na) of the old rig.
    """
    a, b = old.model, new.model
    out = np.zeros((*path.shape[:2], b.nq + b.nv + b.na))
    out[..., : b.nq] = b.qpos0
    for j in range(a.njnt):
        other = b.joint(a.joint(j).name)
        width_q = _width(a, j)
        width_v = {7: 6, 4: 3, 1: 1}[width_q]
        q, v = a.jnt_qposadr[j], a.jnt_dofadr[j]
        to_q, to_v = int(other.qposadr[0]), int(other.dofadr[0])
        out[..., to_q : to_q + width_q] = path[..., q : q + width_q]
        out[..., b.nq + to_v : b.nq + to_v + width_v] = path[..., a.nq + v : a.nq + v + width_v]
    out[..., b.nq + b.nv :] = path[..., a.nq + a.nv :]
    if isinstance(effect, SplitJoint):
        joint = a.joint(effect.part)
        load = _load(a, segments, path)[..., int(joint.dofadr[0])]
        bend = effect.static_deflection(load)
        rate = np.gradient(bend, segments.interval, axis=1)
        own, motor = b.joint(deflection(effect.part)), b.joint(effect.part)
        out[..., int(own.qposadr[0])] = bend
        out[..., b.nq + int(own.dofadr[0])] = rate
        if effect.reads_link:
            out[..., int(motor.qposadr[0])] -= bend
            out[..., b.nq + int(motor.dofadr[0])] -= rate
    return out


def _width(model: mujoco.MjModel, joint: int) -> int:
    kind = int(model.jnt_type[joint])
    return {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}.get(kind, 1)


def _load(model: mujoco.MjModel, segments: Segments, path: Array) -> Array:
    """(S, L, nv) force that it takes to move the links along a path, rotors left out."""
    S, L = segments.shape
    nq, nv = model.nq, model.nv
    rate = np.gradient(path[..., nq : nq + nv], segments.interval, axis=1)
    data, full = mujoco.MjData(model), np.zeros((nv, nv))
    out = np.zeros((S, L, nv))
    for s in range(S):
        for t in range(L):
            data.qpos[:], data.qvel[:] = path[s, t, :nq], path[s, t, nq : nq + nv]
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_fullM(model, data, full)
            out[s, t] = full @ rate[s, t] - model.dof_armature * rate[s, t] + data.qfrc_bias
    return out


def same_effects(effects: Sequence[JointEffect], instances: Sequence[JointEffect]) -> tuple[JointEffect, ...]:
    """The instances on another rig of the same effects."""
    by_key = {effect.key: effect for effect in instances}
    return tuple(by_key[effect.key] for effect in effects)
