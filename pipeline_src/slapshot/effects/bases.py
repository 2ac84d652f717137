"""Smooth functions of the place on the board: Gaussian bumps on a grid."""

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
        """sum_j weights_j phi_j at n places, (n,); weights (bumps, n), each place has its own."""
        grid, (along_x, along_y), _ = self._factors(weights, x, y)
        return ((grid * along_y).sum(1) * along_x).sum(0)

    def slope(self, weights: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """Gradient of `total`, (n,), (n,) per m."""
        grid, (along_x, along_y), (to_x, to_y) = self._factors(weights, x, y)
        return (
            ((grid * along_y).sum(1) * along_x * to_x).sum(0) / self.width**2,
            ((grid * (along_y * to_y)).sum(1) * along_x).sum(0) / self.width**2,
        )

    def _factors(
        self, weights: Array, x: Array, y: Array
    ) -> tuple[Array, tuple[Array, Array], tuple[Array, Array]]:
        """A Gaussian in two dimensions is a product: far fewer exponentials than bumps."""
        to_x, to_y = self.axes[0][:, None] - x, self.axes[1][:, None] - y
        along_x = np.exp(-(to_x**2) / (2 * self.width**2))
        along_y = np.exp(-(to_y**2) / (2 * self.width**2))
        return weights.reshape(*self.counts, len(x)), (along_x, along_y), (to_x, to_y)


# Over the board of the scenes here; where nothing moves, coefficients stay at their prior.
BOARD = Bumps(low=(0.3, -1.2), high=(2.7, 1.2), counts=(7, 7), width=0.32)
