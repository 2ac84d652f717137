"""Readings that are older than their time stamps."""

from collections.abc import Iterator

from slapshot.effects.joints.effect import Array, JointEffect, Observed, Parameter, Situation


class EncoderDelay(JointEffect):
    name = "encoder_delay"
    physics = "Readings are filtered or sent late: what is stamped now was measured before."
    source = "Furgale, Rehder, Siegwart (2013), IROS"
    phrase = "delay of the readings"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["EncoderDelay"]:
        """One of all readings, where there are controls to hold them against; prior: 10 ms."""
        if rig.model.nu:
            yield cls("", [Parameter("delay", "s", 0.01, low=-0.1, high=0.1, probe=1e-3)])

    def observe(self, seen: Observed, values: Array) -> Array:
        """Reading of an earlier time, to second order: for delays that are short against the motion."""
        return -values[0] * seen.rate + values[0] ** 2 / 2 * seen.bend

    def note(self, values: Array) -> str:
        """By how much."""
        sign = "-" if values[0] >= 0 else "+"
        return f"The reading for time t is what the simulation has at t {sign} {abs(values[0]):.4g} s."
