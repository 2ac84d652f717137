"""What effects of the slide do to an object between the striker and its release."""

from collections.abc import Mapping, Sequence

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, SlideState
from slapshot.effects.slide_law import ActiveEffect, accelerations

RADIUS = 0.03  # m of what slides: the change is small, and hardly depends on it


class OnTheWay:
    """What the slide does to n launches while objects slide freely before their release."""

    def __init__(self, launches: Array, way: Array, order: Array, friction: Array) -> None:
        """Of n hits.

        Args:
            launches: (n, 5) x, y, vx, vy, spin at the release without effects.
            way: (n,) s for which objects have slid freely by then.
            order: (n,) place in the recording, -1/2 to 1/2.
            friction: (n, 3) mu_x, mu_y, torsional in m, with which they were simulated.
        """
        self._way, self._order = way, order
        self._middle = np.zeros((len(launches), 6))
        self._middle[:, :2] = launches[:, :2] - way[:, None] / 2 * launches[:, 2:4]
        self._middle[:, 3:] = launches[:, 2:]
        self._without = self._accelerations([], friction)

    def shift(self, effects: Sequence[tuple[Effect, Mapping[str, float]]], friction: Array) -> Array:
        """Change (n, 5) of launches in m, m/s and rad/s under effects with their values and friction (n, 3).

        The way is a few centimetres: forces are those in its middle. Spin is left as it is.
        """
        return self._shifted(self._accelerations(effects, friction) - self._without)

    def by_shapes(self, effect: Effect, parameters: Sequence[str]) -> Array | None:
        """(n, 5, p) of the same by parameters in which an effect is linear; None if it is not."""
        x, y, yaw, vx, vy, spin = self._middle.T
        state = SlideState(x, y, yaw, vx, vy, spin, self._way / 2, self._order)
        push = effect.push_shapes(parameters, state)
        rub = effect.log_friction_shapes(parameters, state)
        if push is None and rub is None:
            return None
        change = np.zeros((len(parameters), len(x), 2))
        if push is not None:
            change += np.stack(push, axis=-1)
        if rub is not None:
            change += rub[..., None] * self._without
        return np.stack([self._shifted(one) for one in change], axis=-1)

    def _shifted(self, change: Array) -> Array:
        shift = np.zeros((len(self._way), 5))
        shift[:, :2] = change * self._way[:, None] ** 2 / 2
        shift[:, 2:4] = change * self._way[:, None]
        return shift

    def _accelerations(self, effects: Sequence[tuple[Effect, Mapping[str, float]]], friction: Array) -> Array:
        """(n, 2) m/s^2 in the middle of the way."""
        count = len(self._way)
        rows = np.arange(count)
        acting = [ActiveEffect(e, rows, {p: np.asarray(x) for p, x in v.items()}) for e, v in effects]
        return accelerations(self._middle, friction, RADIUS, acting, self._way / 2, self._order)
