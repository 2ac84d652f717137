"""Tracking lag: the servos follow a smoothed command."""

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter


class TrackingLag(Effect):
    name = "tracking_lag"
    phase = "swing"
    follows = "command"
    parameters = (Parameter("time", "s", 0.0, 0.2, 0.01, "the command runs through a low-pass"),)
    physics = (
        "A controller's input filter, T dy/dt = u - y: slow parts pass T late, fast ones are smoothed.\n"
        "The swing comes late like one that is delayed, and rounded, so that short peaks get lower."
    )
    source = "Astrom and Murray, Feedback Systems, chapter 6 (linear systems)"
    known_to, errs_by_joint = 0.3, True

    def command(self, values: Mapping[str, float], targets: Array, period: float) -> Array:
        """The filter's exact answer to targets that are linear between ticks, steady at the first.

        y_k = a y_(k-1) + (1 - a - g) u_(k-1) + g u_k with a = exp(-period / T), g = 1 - (1 - a) T / period.
        """
        time = values["time"]
        if time == 0:
            return targets
        a = np.exp(-period / time)
        g = 1 - (1 - a) * time / period
        steady = (1 - g) * targets[:1]
        return lfilter([g, 1 - a - g], [1, -a], targets, axis=0, zi=steady)[0]
