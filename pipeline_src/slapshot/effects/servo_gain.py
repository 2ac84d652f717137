"""Servo gain: the arm's servos are softer or stiffer than believed."""

from collections.abc import Mapping

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo


class ServoGain(Effect):
    name = "servo_gain"
    phase = "swing"
    follows = "command"
    parameters = (Parameter("log_gain", "1", -2.0, 2.0, 0.5, "log of true over believed gain"),)
    physics = (
        "Servos pull with kp (target - q) - kv dq/dt; both gains of all joints change by one factor.\n"
        "Softer ones lag behind what accelerates, swing past where it slows, and yield more to the impact."
    )
    source = (
        "Siciliano et al., Robotics: Modelling, Planning and Control, section 8.3 (decentralised control)"
    )
    known_to, errs_by_joint = 0.3, True

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Scale kp and kv of the position actuators on the arm's joints; limits of force stay."""
        factor = np.exp(values["log_gain"])
        for actuator in spec.actuators:
            if actuator.target in info.joints and actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE:
                actuator.gainprm = _scaled(actuator.gainprm, 1, factor)
                actuator.biasprm = _scaled(actuator.biasprm, 3, factor)


def _scaled(numbers: Array, count: int, factor: float) -> Array:
    """The first `count` numbers, which hold kp, or 0, -kp, -kv, times the factor."""
    scaled = np.array(numbers)
    scaled[:count] *= factor
    return scaled
