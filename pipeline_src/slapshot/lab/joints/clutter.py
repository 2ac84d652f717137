"""Unstructured model errors: laws of a rig that deviate from its model without any named effect.

Every actuator force and every joint's own damping is multiplied by 1 + h, h a smooth random function of the
joint's speed and of what its actuator does, that is 10 % rms. Its component along a gain error is removed:
over the session's motion, force h is uncorrelated with force, so that it is a pure shape error.
"""

import numpy as np

from slapshot.arrays import Array
from slapshot.json_types import JsonObject
from slapshot.lab.joints.hidden_effect import Law, NominalMotion, Plant, StepState

LAW_ERROR = 0.1  # rms of h
_WAVES = 8
_LENGTH = 0.6  # of waves in usual speeds and forces, over 2 pi


class LawError:
    """Random model errors of the rig of a session.

    Args:
        setting: how it moves.
        rng: source of the random functions.
    """

    def __init__(self, nominal: NominalMotion, rng: np.random.Generator) -> None:
        joints = range(len(nominal.rig.joints))
        self._scale = np.array([(nominal.speed(j), nominal.force(j)) for j in joints])
        size = (2, len(joints), _WAVES)  # of actuators and of joints' damping
        self._waves = rng.normal(0, 1 / _LENGTH, (*size, 2))
        self._phase = rng.uniform(0, 2 * np.pi, size)
        self._height = rng.normal(size=size)
        self._offset = np.zeros(size[:2])
        flat = (nominal.speeds.reshape(-1, len(joints)), nominal.forces.reshape(-1, len(joints)))
        for own, law in enumerate((flat[1], flat[0])):
            power = law**2 / (law**2).mean(0)
            self._offset[own] = -(self._factor(own, *flat) * power).mean(0)
            share = LAW_ERROR / np.sqrt((self._factor(own, *flat) ** 2).mean(0))
            self._height[own] *= share[:, None]
            self._offset[own] *= share

    def actuators(self, speed: Array, force: Array) -> Array:
        """H of actuators (..., joints)."""
        return self._factor(0, speed, force)

    def dampings(self, speed: Array, force: Array) -> Array:
        """H of joints' own damping (..., joints)."""
        return self._factor(1, speed, force)

    def _factor(self, own: int, speed: Array, force: Array) -> Array:
        typical = np.stack((speed, force), axis=-1) / self._scale
        angle = (self._waves[own] @ typical[..., None])[..., 0] + self._phase[own]
        return (self._height[own] * np.cos(angle)).sum(-1) + self._offset[own]

    def law(self, plant: Plant) -> Law:
        """The law for a simulated rig."""
        return _Law(self, plant)

    def truth(self) -> JsonObject:
        """For the sealed file; waves are (actuators and dampings, joints, waves, speed and force)."""
        return {
            "rms": LAW_ERROR,
            "usual_speed_and_force": self._scale.tolist(),
            "waves": self._waves.tolist(),
            "phase": self._phase.tolist(),
            "height": self._height.tolist(),
            "offset": self._offset.tolist(),
        }


class _Law(Law):
    def __init__(self, error: LawError, plant: Plant) -> None:
        self._error = error
        self._dofs = [plant.dof(name) for name in plant.rig.joints]
        self._damping = np.array(plant.rig.damping)

    def drive(self, force: Array, state: StepState) -> None:
        force *= 1 + self._error.actuators(state.velocity, force)

    def act(self, torque: Array, state: StepState) -> None:
        own = self._damping * state.velocity
        torque[:, self._dofs] -= own * self._error.dampings(state.velocity, state.load)
