"""What is known of launches before their slides are seen: nothing, or what commands should give."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.slide.slide_model import Column, Point, Values

SPIN = 4  # place of the spin in a launch
LAUNCH = 5  # numbers of a launch: x, y (m), vx, vy (m/s), spin (rad/s)
NEARLY_FLAT = 0.1  # 1/m and s/m: nothing beside a frame, but a hit that does not move has one
UNKNOWN_SPIN_SD = 3.0  # rad/s: what oblique hits give


class LaunchPrior(Protocol):
    """Gaussian prior of the launches of n hits."""

    @property
    def first_scatter(self) -> Array:
        """(5, 5) covariance from hit to hit before it is estimated; (0, 0) where there is none."""

    @property
    def turned(self) -> Array | None:
        """(n,) rad by which objects turned before their release; None where nothing is known of it."""

    @property
    def flat(self) -> int:
        """Of the numbers of a launch, the first ones on which the prior says nothing."""

    @property
    def rows(self) -> int:
        """Expected squares that the prior adds to those of the frames of one hit."""

    def offsets(self, point: Point) -> Array:
        """(n, 5) means less launches at a point."""

    def slopes(self, columns: Sequence[Column], point: Point) -> Array:
        """(n, 5, p) of the means by columns."""

    def roots(self, scatter: Array, measured: Array, noise: Array) -> tuple[Array, Array]:
        """Square root information (n, 5, 5) and log determinant of the covariance (n,).

        Args:
            scatter: (5, 5) from hit to hit.
            measured: (n, 5) means less launches that slides alone tell, by which wild hits weigh less.
            noise: (n, 5, 5) covariance of those.
        """

    def scatter(self, point: Point, measured: Array, noise: Array, before: Array) -> Array:
        """(5, 5) as it follows from launches (n, 5) that slides alone tell, with covariance (n, 5, 5)."""

    def encoder_rows(self, columns: Sequence[Column], point: Point) -> tuple[Array, Array] | None:
        """Whitened residuals of encoders (n, rows) and their derivatives (n, rows, p); None without any."""

    def sizes(self, name: str) -> Sequence[Values]:
        """Values at which an effect was simulated, but for the neutral ones."""

    def misfit(self, point: Point, measured: Array, noise: Array, scatter: Array) -> float:
        """-2 log likelihood of launches (n, 5) that were measured with covariance (n, 5, 5)."""

    def simulated_spin(self, point: Point) -> tuple[Array, float]:
        """(n,) rad/s that is expected, and its sd: what is known where a launch is told by its slide."""


@dataclass(frozen=True)
class UnknownLaunch:
    """Of n hits whose launches only their slides tell.

    Attributes:
        count: n.
        spin: (n,) rad/s that is expected; None for 0, since it is to the left as often as to the right.
        spin_sd: rad/s.
        rows: less 4, since place and velocity are fitted.
    """

    count: int
    spin: Array | None = None
    spin_sd: float = UNKNOWN_SPIN_SD
    rows: int = -SPIN
    flat: ClassVar[int] = SPIN
    turned: ClassVar[None] = None

    @property
    def first_scatter(self) -> Array:
        """None."""
        return np.zeros((0, 0))

    def offsets(self, point: Point) -> Array:
        """Zero but for spin: the prior is flat."""
        offsets = np.zeros((self.count, LAUNCH))
        offsets[:, SPIN] = self.simulated_spin(point)[0] - point.latents[:, SPIN]
        return offsets

    def slopes(self, columns: Sequence[Column], point: Point) -> Array:
        """Zero."""
        return np.zeros((self.count, LAUNCH, len(columns)))

    def roots(self, scatter: Array, measured: Array, noise: Array) -> tuple[Array, Array]:
        """Nearly flat but for the spin."""
        root = np.diag([NEARLY_FLAT] * SPIN + [1 / self.spin_sd])
        return np.tile(root, (self.count, 1, 1)), np.zeros(self.count)

    def scatter(self, point: Point, measured: Array, noise: Array, before: Array) -> Array:
        """None."""
        return before

    def encoder_rows(self, columns: Sequence[Column], point: Point) -> None:
        """None."""
        return

    def sizes(self, name: str) -> Sequence[Values]:
        """None."""
        return ()

    def misfit(self, point: Point, measured: Array, noise: Array, scatter: Array) -> float:
        """None."""
        return 0.0

    def simulated_spin(self, point: Point) -> tuple[Array, float]:
        """As given."""
        return np.zeros(self.count) if self.spin is None else self.spin, self.spin_sd
