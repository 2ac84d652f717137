"""Force limit of an actuator."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import shown

# Sharpness of the soft onset of a limit: at 56 and 89 % of it the force is half a per cent too low.
SHARPNESS = (6.0, 20.0)


class Saturation(JointEffect):
    name = "saturation"
    physics = "Current or torque is limited, by the amplifier or by its settings."
    source = "Astrom, Murray, Feedback Systems (2008), section 10.4"
    phrase = "torque limit of actuator {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Saturation"]:
        """One for each actuator of a joint.

        The limit is parametrised by the share of its largest force along the recorded motion that is cut off.
        """
        for joint in rig.joints:
            for actuator, largest in zip(joint.actuators, joint.largest, strict=True):
                if largest > 0:
                    cut = Parameter("cut", "1", 0.4, low=0.0, high=0.98, probe=0.2)
                    yield cls(shown(rig.model.actuator(actuator).name), actuator, largest, cut)

    def __init__(self, part: str, actuator: int, largest: float, parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._actuator, self._largest = actuator, largest

    @property
    def probe_values(self) -> tuple[tuple[float, ...], ...]:
        """Several limits, since one that is never reached has no gradient."""
        return ((0.02,), (0.1,), (0.3,), (0.6,))

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Limit the force before the gear; a tighter limit of the model is kept."""
        limit = self._largest * (1 - values[0])
        low, high = -limit, limit
        if model.actuator_forcelimited[self._actuator]:
            nominal = model.actuator_forcerange[self._actuator]
            low, high = max(low, nominal[0]), min(high, nominal[1])
        if values[0] > 0:
            model.actuator_forcelimited[self._actuator] = 1
            model.actuator_forcerange[self._actuator] = low, high

    def soft_limit(self, model: mujoco.MjModel, force: Array, values: Array) -> tuple[int, Array]:
        """Soft saturation: F / (1 + |F / L|^p)^(1/p), less the hard limit."""
        own, limit = force[:, self._actuator], max(self._largest * (1 - float(values[0])), 1e-300)
        share = np.abs(own / limit)[:, None]
        # In a form that does not overflow.
        top = np.maximum(share, 1.0)
        power = np.array(SHARPNESS)
        soft = share / (top * ((1 / top) ** power + (share / top) ** power) ** (1 / power))
        lacking = np.sign(own)[:, None] * limit * (soft - np.minimum(share, 1.0)) * (values[0] > 0)
        joint = int(model.actuator_trnid[self._actuator, 0])
        return int(model.jnt_dofadr[joint]), lacking * float(model.actuator_gear[self._actuator, 0])
