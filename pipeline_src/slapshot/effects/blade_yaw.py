"""Blade yaw: the blade is turned on its stick."""

from collections.abc import Mapping

import mujoco
import numpy as np

from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo
from slapshot.scenes.striker import Striker


class BladeYaw(Effect):
    name = "blade_yaw"
    phase = "contact"
    follows = "heading"
    parameters = (Parameter("angle", "rad", -0.5, 0.5, 0.04, "anticlockwise, looking down the stick"),)
    physics = (
        "A blade clamped askew, or one that slipped: its face looks beside where the stick is swung.\n"
        "All launches turn the same way, by the angle less what friction along the face holds back, and spin."
    )
    source = "Cross 2002, Grip-slip behavior of a bouncing ball (American Journal of Physics 70)"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Turn the geom about the stick; the site stays, as it is where one believes the face to be."""
        angle = values["angle"]
        if angle == 0:
            return
        striker = Striker.of(spec, info)
        turn, matrix = np.empty(4), np.empty(9)
        mujoco.mju_axisAngle2Quat(turn, striker.up, angle)
        mujoco.mju_quat2Mat(matrix, turn)
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, turn, striker.quat)
        striker.geom.fromto = np.full(6, np.nan)
        striker.geom.pos = striker.site + matrix.reshape(3, 3) @ (striker.pos - striker.site)
        striker.geom.quat = quat
        striker.geom.size = striker.size
