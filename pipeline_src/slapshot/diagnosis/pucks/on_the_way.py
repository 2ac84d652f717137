"""What effects of the slide do to an object between the striker and its release."""

from collections.abc import Mapping, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect
from slapshot.effects.slide_law import ActiveEffect, slide

RADIUS = 0.03  # m of what slides: the change is small, and hardly depends on it
SHORT = 1e-2  # s, over which speed is told


def shift_on_the_way(
    effects: Sequence[tuple[Effect, Mapping[str, float]]],
    launches: Array,
    way: Array,
    order: Array,
    friction: tuple[Array, Array],
) -> Array:
    """Change (n, 5) of launches in m, m/s and rad/s; spin is left as it is.

    Args:
        effects: with their values.
        launches: (n, 5) x, y, vx, vy, spin without them.
        way: (n,) s for which objects have slid freely by then.
        order: (n,) place in the recording, -1/2 to 1/2.
        friction: (n, 3) mu_x, mu_y, torsional in m without and with the effects.
    """
    shift = np.zeros_like(launches)
    count = len(launches)
    begin = np.zeros((count, 6))
    begin[:, :2] = launches[:, :2] - way[:, None] * launches[:, 2:4]
    begin[:, 3:] = launches[:, 2:]
    rows = np.arange(count)
    acting = [ActiveEffect(e, rows, {p: np.full(count, x) for p, x in v.items()}) for e, v in effects]
    moments = np.stack([way, way + SHORT], axis=1)
    duration = float(moments.max()) + SHORT
    plain = slide(begin, friction[0], RADIUS, duration, [], order).at(moments)
    changed = slide(begin, friction[1], RADIUS, duration, acting, order).at(moments)
    change = changed - plain
    shift[:, :2], shift[:, 2:4] = change[:, 0], (change[:, 1] - change[:, 0]) / SHORT
    return shift
