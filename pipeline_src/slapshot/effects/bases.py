"""Smooth functions of the place on the board: Gaussian bumps on a grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slapshot.arrays import Array


@dataclass(frozen=True)
class Bumps:
    """phi_j(x, y) = exp(-|(x, y) - c_j|^2 / (2 width^2)), c_j on a square grid.

    Attributes:
        low, high: (x, y) in m of the first and of the last centre.
        counts: centres along x and along y.
        width: m.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    counts: tuple[int, int]
    width: float

    @cached_property
    def axes(self) -> tuple[Array, Array]:
        """Centres along x and along y in m; bump j stands at x j // counts[1], y j % counts[1]."""
        return (
            np.linspace(self.low[0], self.high[0], self.counts[0]),
            np.linspace(self.low[1], self.high[1], self.counts[1]),
        )

    def __len__(self) -> int:
        return self.counts[0] * self.counts[1]

    def near(self, j: int, places: Array) -> bool:
        """Whether any of the places (n, 2) feels bump j: it is within 2.5 widths."""
        along_x, along_y = self.axes
        centre = (along_x[j // self.counts[1]], along_y[j % self.counts[1]])
        return bool((((places - centre) ** 2).sum(-1) < (2.5 * self.width) ** 2).any())

    def total(self, weights: Array, x: Array, y: Array) -> Array:
        """sum_j weights_j phi_j at n places, (n,); weights (bumps,), or (bumps, n) of each place."""
        (along_x, along_y), _ = self._factors(x, y)
        return self._sum(weights, along_x, along_y)

    def slope(self, weights: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of `total`, (n,), (n,) per m."""
        (along_x, along_y), (slope_x, slope_y) = self._factors(x, y)
        return self._sum(weights, slope_x, along_y), self._sum(weights, along_x, slope_y)

    def shapes(self, which: Sequence[int], x: Array, y: Array) -> Array:
        """(bumps, n) some bumps at n places."""
        (along_x, along_y), _ = self._factors(x, y)
        return self._product(which, along_x, along_y)

    def slopes(self, which: Sequence[int], x: Array, y: Array) -> tuple[Array, Array]:
        """Gradients of some bumps, (bumps, n), (bumps, n) per m."""
        (along_x, along_y), (slope_x, slope_y) = self._factors(x, y)
        return self._product(which, slope_x, along_y), self._product(which, along_x, slope_y)

    def _factors(self, x: Array, y: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """A Gaussian in two dimensions is a product, of factors (centres, n); and these factors' slopes."""
        to_x, to_y = self.axes[0][:, None] - x, self.axes[1][:, None] - y
        along_x = np.exp(-(to_x**2) / (2 * self.width**2))
        along_y = np.exp(-(to_y**2) / (2 * self.width**2))
        return (along_x, along_y), (along_x * to_x / self.width**2, along_y * to_y / self.width**2)

    def _sum(self, weights: Array, of_x: Array, of_y: Array) -> Array:
        if weights.ndim == 1:
            return np.einsum("in,in->n", of_x, weights.reshape(self.counts) @ of_y)
        return np.einsum("in,in->n", of_x, (weights.reshape(*self.counts, -1) * of_y).sum(1))

    def _product(self, which: Sequence[int], of_x: Array, of_y: Array) -> Array:
        i, j = np.divmod(np.asarray(which, int), self.counts[1])
        return of_x[i] * of_y[j]


# Over the board of the scenes here; where nothing moves, coefficients stay at their prior. Waves of 0.4 m can
# be told; what has no name is described more coarsely.
BOARD = Bumps(low=(0.3, -1.2), high=(2.7, 1.2), counts=(13, 13), width=0.17)
COARSE_BOARD = Bumps(low=(0.3, -1.2), high=(2.7, 1.2), counts=(7, 7), width=0.32)
