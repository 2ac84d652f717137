"""Dead time of commands."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import of_actuators


class CommandDelay(JointEffect):
    name = "command_delay"
    physics = "Bus and controller pass a command on after a dead time."
    source = "Tan et al. (2018), Robotics: Science and Systems"
    phrase = "delay of {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["CommandDelay"]:
        """One for each actuator and one for all; prior: 20 ms."""
        yield from of_actuators(cls, rig, Parameter("delay", "s", 0.02, low=0.0, high=1.0, probe=1e-3))

    def __init__(self, part: str, actuators: tuple[int, ...], parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._actuators = list(actuators)

    def control(self, u: Array, step: float, values: Array) -> Array:
        """Shift the means over steps, by interpolating the integral, which allows fractional delays."""
        out = u.copy()
        commands = u[:, self._actuators]
        ticks = np.arange(len(u) + 1.0)
        integral = np.concatenate([np.zeros((1, commands.shape[1])), np.cumsum(commands, axis=0)])
        late = ticks - values[0] / step
        for i, actuator in enumerate(self._actuators):
            # Before the episode the first command held.
            moved = np.where(late < 0, late * commands[0, i], np.interp(late, ticks, integral[:, i]))
            out[:, actuator] = np.diff(moved)
        return out

    def note(self, values: Array) -> str:
        """The delay."""
        return (
            f"Delay the controls of {self.part} by {values[0]:.4g} s; before that time the first command "
            "holds."
        )
