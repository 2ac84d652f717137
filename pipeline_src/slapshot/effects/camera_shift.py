"""A shift of what a camera reports: a turn about an unknown point is one about another and a shift."""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Parameter

SHIFT = (
    Parameter("shift_x", "m", -0.2, 0.2, 0.01, "places are reported farther along x"),
    Parameter("shift_y", "m", -0.2, 0.2, 0.01, "places are reported farther along y"),
)


def shifted(values: Mapping[str, Array], places: Array) -> Array:
    """Places (n, frames, 2) in m, shifted."""
    return places + np.stack([values["shift_x"], values["shift_y"]], axis=-1)[:, None]
