"""Parts of a model, and helpers for effects on them."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Parameter, RigMotion

_COUNTS = 1e-3  # of the total mass: lighter bodies are not identifiable
_STIFFEST = 0.9999  # impedance that MuJoCo allows


def shown(name: str) -> str:
    """Name of an actuator for the user: an added motor has the name of its joint."""
    return name.removeprefix("slapshot:")


def level(gravity: Array) -> list[int]:
    """The two axes (0 to 2) of the world that are closest to level; x and y without gravity."""
    upright = int(np.argmax(np.abs(gravity))) if np.any(gravity) else 2
    return [axis for axis in range(3) if axis != upright]


def freely(body: str, law: str) -> str:
    """Instruction for adding a force on a free body, a law of its velocity v, to a simulation."""
    return (
        f"Apply as qfrc_applied at the free joint of body {body}, its first three numbers: {law} "
        "(in N; velocity v in m/s, all in the axes of the world)."
    )


def of_actuators(kind: Any, rig: RigMotion, parameter: Parameter) -> Iterator[Any]:
    """An effect on all actuators and, of several, on each, and on each mocap body."""
    model, count = rig.model, rig.model.nu
    if count:
        part = "all actuators" if count > 1 else shown(rig.model.actuator(0).name)
        yield kind(part, tuple(range(count)), parameter)
    if count > 1:
        for i in range(count):
            yield kind(shown(rig.model.actuator(i).name), (i,), parameter)
    for body in np.flatnonzero(model.body_mocapid >= 0):
        i, quaternions = int(model.body_mocapid[body]), count + 3 * model.nmocap
        place = tuple(range(count + 3 * i, count + 3 * i + 3))
        turn = tuple(range(quaternions + 4 * i, quaternions + 4 * i + 4))
        yield kind(model.body(body).name, place + turn, parameter)


def carriers(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and its ancestors, without the world."""
    chain = []
    while body:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain


def moving_bodies(model: mujoco.MjModel) -> list[int]:
    """Bodies of the given model that are moved by some joint and have a relevant mass."""
    least = _COUNTS * float(model.body_mass.sum())
    return [
        body
        for body in range(1, model.nbody)
        if model.body_weldid[body] != 0
        and model.body_mass[body] > least
        and not model.body(body).name.startswith("slapshot:")
    ]


def weight(model: mujoco.MjModel, body: int) -> float:
    """Weight of a body in N; of 1 g acceleration where the model has no gravity."""
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    return float(model.body_mass[body]) * gravity


def far_end(model: mujoco.MjModel, body: int) -> tuple[Array, float]:
    """The point of a body that lies farthest from its joint, in its frame, and the body's length in m."""
    joint = model.body_jntadr[body]
    anchor = model.jnt_pos[joint] if joint >= 0 else np.zeros(3)
    arms, length = [2 * (model.body_ipos[body] - anchor)], 0.02
    for geom in np.flatnonzero(model.geom_bodyid == body):
        arm, size = model.geom_pos[geom] - anchor, float(model.geom_rbound[geom])
        along = float(np.linalg.norm(arm))
        arms.append(arm * (1 + size / along) if along > 1e-9 else arm)
        length = max(length, along + size)
    end = max(arms, key=lambda arm: float(np.linalg.norm(arm)))
    return np.array(anchor + end), max(float(np.linalg.norm(end)), length)


def add_point_mass(model: mujoco.MjModel, body: int, mass: float, place: Array) -> None:
    """Fix a point mass (kg) at a place (m) in the frame of a body; its mass, centre and inertia change."""
    if mass == 0:
        return
    before, centre = float(model.body_mass[body]), model.body_ipos[body].copy()
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    total = before + mass
    middle = (before * centre + mass * np.asarray(place)) / total
    for part, at in ((before, centre), (mass, np.asarray(place))):
        arm = at - middle
        inertia = inertia + part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    principal, vectors = np.linalg.eigh(inertia)
    if np.linalg.det(vectors) < 0:
        vectors[:, 0] *= -1
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(vectors).ravel())
    model.body_mass[body], model.body_ipos[body] = total, middle
    model.body_inertia[body], model.body_iquat[body] = principal, quaternion


def add_friction(model: mujoco.MjModel, dof: int, torque: float) -> None:
    """Add Coulomb friction to a degree of freedom.

    MuJoCo's friction pulls a joint to the velocity at which its constraint decays, by default in 10 ms: a
    joint that slows down faster feels friction turn around before it does. Where a model has no friction of
    its own, the constraint stops the joint in one of its steps: that is Coulomb's law.
    """
    if model.dof_frictionloss[dof] == 0:
        model.dof_solref[dof] = -1.0, -1.0 / model.opt.timestep
        model.dof_solimp[dof, :2] = _STIFFEST
    model.dof_frictionloss[dof] += torque
