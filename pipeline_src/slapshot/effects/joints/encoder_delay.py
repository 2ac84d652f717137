"""Delay of readings relative to their time stamps."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Observed, Parameter, RigMotion, SensedChannel

ALL_SENSORS = "all sensors"
SITES_AND_BODIES = "sites and bodies"


class EncoderDelay(JointEffect):
    name = "encoder_delay"
    physics = "Readings are filtered or sent late: what is stamped now was measured before."
    source = "Furgale, Rehder, Siegwart (2013), IROS"
    phrase = "delay of the readings of {part}"
    both_signs = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["EncoderDelay"]:
        """One for each set of readings that one device may send late; prior: 10 ms.

        Sets are the readings of a joint, its velocity or torque alone where more is read of it, those of
        a clock, those of sites and bodies, and all. Readings that are all late together need a control as a
        reference.
        """
        parameter = Parameter("delay", "s", 0.01, low=-0.1, high=0.1, probe=1e-3)
        sets: dict[tuple[int, ...], tuple[str, str]] = {}  # of equal ones the first counts

        def add(part: str, columns: Iterable[SensedChannel], variant: str = "") -> None:
            sets.setdefault(tuple(sensed.column for sensed in columns), (part, variant))

        for joint in rig.joints:
            own = [sensed for sensed in rig.sensed if sensed.joint == joint.name]
            add(joint.name, own)
            for quantity in sorted({sensed.quantity for sensed in own} - {"position"}):
                add(joint.name, (s for s in own if s.quantity == quantity), f"{quantity} alone")
        clocks = sorted({sensed.clock for sensed in rig.sensed})
        for clock in clocks if len(clocks) > 1 else ():
            add(f"clock {clock}", (sensed for sensed in rig.sensed if sensed.clock == clock))
        if any(sensed.joint is not None for sensed in rig.sensed):
            add(SITES_AND_BODIES, (sensed for sensed in rig.sensed if sensed.joint is None))
        add(ALL_SENSORS, rig.sensed)
        driven = bool(rig.model.nu or rig.model.nmocap)
        for columns, (part, variant) in sets.items():
            if columns and (driven or len(columns) < len(rig.sensed)):
                yield cls(part, columns, parameter, variant)

    def __init__(self, part: str, columns: Sequence[int], parameter: Parameter, variant: str = "") -> None:
        super().__init__(part, (parameter,), variant)
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
        which = f"Readings ({self.variant})" if self.variant else "Readings"
        return f"{which} of {self.part} for time t are what the simulation has at {at}."
