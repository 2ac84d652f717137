"""Delay of readings relative to their time stamps."""

from collections.abc import Iterator, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Observed, Parameter, RigMotion

ALL_SENSORS = "all sensors"


class EncoderDelay(JointEffect):
    name = "encoder_delay"
    physics = "Readings are filtered or sent late: what is stamped now was measured before."
    source = "Furgale, Rehder, Siegwart (2013), IROS"
    phrase = "delay of the readings of {part}"
    both_signs = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["EncoderDelay"]:
        """One for each observed joint and one for all, if controls give a time reference; prior: 10 ms."""
        if not (rig.model.nu or rig.model.nmocap):
            return
        parameter = Parameter("delay", "s", 0.01, low=-0.1, high=0.1, probe=1e-3)
        every = {sensed.column for sensed in rig.sensed}
        for joint in rig.joints:
            own = {sensed.column for sensed in rig.sensed if sensed.joint == joint.name}
            if own:
                yield cls(joint.name, sorted(own), parameter)
            if own == every:
                return
        yield cls(ALL_SENSORS, sorted(every), parameter)

    def __init__(self, part: str, columns: Sequence[int], parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._columns = list(columns)

    def observe(self, seen: Observed, values: Array) -> Array:
        """Taylor expansion to the third order, for delays that are short relative to the motion."""
        late, added, own = values[0], np.zeros_like(seen.y), self._columns
        added[:, own] = -late * seen.rate[:, own] + late**2 / 2 * seen.second_rate[:, own]
        if seen.third_rate is not None:
            added[:, own] -= late**3 / 6 * seen.third_rate[:, own]
        return added

    def note(self, values: Array) -> str:
        """The delay."""
        at = f"t {'-' if values[0] >= 0 else '+'} {abs(values[0]):.4g} s"
        return f"Readings of {self.part} for time t are what the simulation has at {at}."
