"""Command delay: the servos get their targets late."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter


class CommandDelay(Effect):
    name = "command_delay"
    phase = "swing"
    follows = "time"
    parameters = (Parameter("delay", "s", 0.0, 0.2, 0.01, "targets reach the servos late"),)
    physics = (
        "Network, buffers and the controller's cycle hold every target back by the same time.\n"
        "The whole swing comes late and so does the launch, which is otherwise the same."
    )
    source = "Franklin, Powell and Workman, Digital Control of Dynamic Systems, chapter 4 (delays)"

    def command(self, values: Mapping[str, float], targets: Array, period: float) -> Array:
        """Targets of a moment `delay` ago, linear between ticks; before the first one, the first."""
        delay = values["delay"]
        if delay == 0:
            return targets
        last = len(targets) - 1
        position = np.clip(np.arange(last + 1) - delay / period, 0, last)
        low = np.minimum(position.astype(np.int64), max(last - 1, 0))
        share = (position - low)[:, None]
        return (1 - share) * targets[low] + share * targets[np.minimum(low + 1, last)]
