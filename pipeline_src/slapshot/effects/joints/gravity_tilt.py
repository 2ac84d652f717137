"""A base that does not stand upright."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.effects.joints.effect import Array, JointEffect, Parameter, Situation


class GravityTilt(JointEffect):
    name = "gravity_tilt"
    physics = "The base is not level: gravity comes from another direction."
    source = "Hollerbach, Khalil, Gautier, Springer Handbook of Robotics (2016), chapter 6"
    phrase = "tilt of the base"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["GravityTilt"]:
        """One, where there is gravity; prior: 2 degrees."""
        if np.linalg.norm(rig.model.opt.gravity) > 0:
            yield cls("", [Parameter(f"about_{axis}", "rad", 0.035, probe=1e-4) for axis in "xy"])

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Turn gravity about two horizontal axes, against the base."""
        down = model.opt.gravity.copy()
        quaternion, turned = np.zeros(4), np.zeros(3)
        rotation = np.array([-values[0], -values[1], 0.0])
        angle = float(np.linalg.norm(rotation))
        if angle > 0:
            mujoco.mju_axisAngle2Quat(quaternion, rotation / angle, angle)
            mujoco.mju_rotVecQuat(turned, down, quaternion)
            model.opt.gravity[:] = turned
