"""Friction drift: it changes in the course of a recording."""

from collections.abc import Mapping

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter, SlideState


class FrictionDrift(Effect):
    name = "friction_drift"
    phase = "across hits"
    follows = "order"
    parameters = (
        Parameter("log_change", "1", -2.0, 2.0, 0.15, "log of friction at the last hit over the first"),
        Parameter("bend", "1", -1.0, 1.0, 0.03, "log of friction half-way over the mean of both ends"),
    )
    physics = (
        "Wear, dust, or warming change surfaces from hit to hit, less and less: log friction is a parabola.\n"
        "Nothing within one hit tells it from another friction."
    )
    source = "Archard 1953, Journal of Applied Physics 24, Contact and rubbing of flat surfaces"

    def log_friction(self, values: Mapping[str, Array], state: SlideState) -> Array:
        """By the order of the hit, which is -1/2 at the first and 1/2 at the last."""
        return values["log_change"] * state.order + values["bend"] * (1 - 4 * state.order**2)
