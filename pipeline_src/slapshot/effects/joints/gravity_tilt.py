"""Tilt of the base."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import level


class GravityTilt(JointEffect):
    name = "gravity_tilt"
    physics = "The base is not level: gravity comes from another direction."
    source = "Siciliano, Sciavicco, Villani, Oriolo, Robotics (2009), section 7.1"
    phrase = "tilt of the base"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["GravityTilt"]:
        """One, where there is gravity: turns of the base about two level axes; prior: 2 degrees."""
        gravity = rig.model.opt.gravity
        if np.linalg.norm(gravity) > 0:
            axes = level(gravity)
            yield cls(axes, [Parameter(f"about_{'xyz'[axis]}", "rad", 0.035, probe=1e-4) for axis in axes])

    def __init__(self, axes: list[int], parameters: Sequence[Parameter]) -> None:
        super().__init__("", parameters)
        self._axes = axes

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Turn gravity against the base, in whose axes the model stands."""
        rotation = np.zeros(3)
        rotation[self._axes] = -values
        angle = float(np.linalg.norm(rotation))
        if angle > 0:
            quaternion, turned = np.zeros(4), np.zeros(3)
            mujoco.mju_axisAngle2Quat(quaternion, rotation / angle, angle)
            mujoco.mju_rotVecQuat(turned, model.opt.gravity.copy(), quaternion)
            model.opt.gravity[:] = turned
