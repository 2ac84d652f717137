"""The face that fitters of slides and of launches share, so that one search serves both."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.slide.slide_model import Column, Effects, Point, Values
from slapshot.effects.effect import Effect


class Fitter(Protocol):
    """Fits effects to the hits of a recording."""

    effects: Mapping[str, Effect]
    sizes: dict[str, float]  # effect -> size of its prior in scales, where it is not the largest

    def start(self) -> Point:
        """Where a fit without effects begins."""

    def drop_jumps(self, point: Point) -> None:
        """Leave out what was measured wrongly."""

    def fit(self, start: Point, scatter: Any = ..., effects: Sequence[str] = ()) -> Fit:
        """Fit the effects named, what they share with the nominal scene, and the scatter of hits."""

    def starts(self, name: str) -> Sequence[Values]:
        """Values of an effect from which a fit may begin beside a screen's; none where fits are dear."""

    def start_misfit(self, fit: Fit, values: Effects) -> float:
        """-2 log likelihood of what tells those starts apart, under other effects than those of a fit."""

    def quadratic(self, fit: Fit, effects: Sequence[str]) -> tuple[list[Column], Marginal, Array]:
        """Columns, hits marginalised over them, and (n, frames, 2, p) change of some frames in m."""

    def prior(self, columns: Sequence[Column]) -> tuple[Array, Array]:
        """Mean and information (p,) of shared parameters."""

    def shift(self, fit: Fit, name: str) -> float:
        """Root mean square change of tracks in m by an effect of a fit, where it is largest.

        Beyond what another friction would do to them.
        """

    def gain_by_tracks(self, fit: Fit, name: str) -> float:
        """Nats that an effect of a fit adds where nothing is known of launches but what tracks tell."""

    def gain_by_encoders(self, fit: Fit, name: str) -> float:
        """Nats that an effect of a fit adds by what encoders read."""
