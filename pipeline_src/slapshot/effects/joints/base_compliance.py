"""Compliance of the base."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.split import base_joint, put_on_base

_SLOW, _USUAL, _FAST = 10.0, 60.0, 400.0  # natural frequency of the robot on its base, rad/s


class BaseCompliance(JointEffect):
    name = "base_compliance"
    physics = "Table, cart or mounting plate give way: the whole robot tilts under its own forces."
    source = "Siciliano, Khatib (eds.), Springer Handbook of Robotics (2016), chapter 11"
    phrase = "compliance of the base"
    hidden_state = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["BaseCompliance"]:
        """One, of robots that stand on the world; prior: a mode at 10 Hz, tilting about each level axis."""
        if not rig.joints or rig.free_bodies:
            return
        inertia = inertia_about_base(rig.model)
        compliance = 1 / (inertia * _USUAL**2)
        damping = 0.2 * np.sqrt(inertia / compliance)
        least, most = 1 / (inertia * _FAST**2), 1 / (inertia * _SLOW**2)
        yield cls(
            inertia,
            Parameter("about_x", "rad/(N m)", compliance, compliance, least, most),
            Parameter("about_y", "rad/(N m)", compliance, compliance, least, most),
            Parameter("damping", "N m s/rad", damping, damping, 0.0),
        )

    def __init__(self, inertia: float, *parameters: Parameter) -> None:
        super().__init__("", parameters)
        self._inertia = inertia

    @property
    def fastest(self) -> float:
        """Of the stiffest mount that is fitted."""
        return _FAST

    @property
    def added_joint(self) -> str:
        """Tilt about x."""
        return base_joint("x")

    def restructure(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Mount the robot on a plate that tilts about two axes."""
        return put_on_base(spec, 0.05 * self._inertia)

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Spring of each axis, and the damper of both."""
        *compliances, damping = values
        for axis, compliance in zip("xy", compliances, strict=True):
            joint = model.joint(base_joint(axis))
            model.jnt_stiffness[joint.id] = 1 / compliance
            model.dof_damping[joint.dofadr[0]] = damping


def inertia_about_base(model: mujoco.MjModel) -> float:
    """Inertia of all that moves about a level axis through the foot of the robot, kg m^2."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    moving = [b for b in range(1, model.nbody) if model.body_weldid[b] != 0]
    first = min(moving, key=lambda b: int(model.body_rootid[b]) * 1000 + b)
    foot = data.xpos[first]
    total = sum(
        float(model.body_mass[b]) * float(np.sum((data.xipos[b] - foot) ** 2))
        + float(model.body_inertia[b].max())
        for b in moving
    )
    return max(total, 1e-6)
