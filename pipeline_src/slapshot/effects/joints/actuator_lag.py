"""First-order lag of an actuator."""

from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import of_actuators


class ActuatorLag(JointEffect):
    name = "actuator_lag"
    physics = "Current loop and filters pass a command on with a first-order lag."
    source = "Siciliano, Sciavicco, Villani, Oriolo, Robotics (2009), section 5.2"
    phrase = "lag of {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["ActuatorLag"]:
        """One for each actuator and one for all; prior: 20 ms."""
        yield from of_actuators(
            cls, rig, Parameter("time_constant", "s", 0.02, low=0.0, high=1.0, probe=1e-3)
        )

    def __init__(self, part: str, actuators: tuple[int, ...], parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._actuators = list(actuators)

    def control(self, u: Array, step: float, values: Array) -> Array:
        """A first-order filter, at rest before the episode."""
        if values[0] <= 0:
            return u
        decay = np.exp(-step / values[0])
        # Mean of the response over a step, exact for a held input.
        mean = values[0] / step * (1 - decay)
        out = u.copy()
        commands = u[:, self._actuators]
        start = commands[:1] * 1.0
        state, _ = lfilter([1 - decay], [1, -decay], commands, axis=0, zi=decay * start)
        before = np.concatenate([start, state[:-1]])
        out[:, self._actuators] = commands + mean * (before - commands)
        return out

    def note(self, values: Array) -> str:
        """The discrete filter."""
        return (
            f"Filter the controls of {self.part}: in every step of h s, c += (1 - exp(-h / T)) (u - c) with "
            f"T = {values[0]:.4g} s; the actuator is given c, which begins at the first command."
        )
