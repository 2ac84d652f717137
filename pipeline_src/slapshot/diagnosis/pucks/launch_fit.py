"""Fit of a recording's launches: what its slides say of each launch against what its command should give.

The slides were fitted before, each with a launch of its own. Their posterior is a measurement of the launch,
with a covariance of its own; where it differs from the command's by more than launches scatter, swing,
contact or camera lacks something. No slide is simulated here, so that all effects are fitted in a moment.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.gauss_newton import Fit, GaussNewton
from slapshot.diagnosis.pucks.launch import FIRST_SD, LaunchModel
from slapshot.diagnosis.pucks.marginal import Marginal
from slapshot.diagnosis.pucks.slide_fit import SlideFitter
from slapshot.diagnosis.pucks.slide_model import STEP_SHARE, Column, Point, Values
from slapshot.diagnosis.pucks.told import told_launches
from slapshot.effects.effect import Effect

_NO_INFORMATION = 1e-6  # keeps the information of what a slide does not tell (spin) from being singular


class LaunchFitter(GaussNewton):
    """Fits the launches of n hits."""

    iterations = 40
    first_scatter = np.diag(FIRST_SD**2)

    def __init__(
        self,
        model: LaunchModel,
        effects: Mapping[str, Effect],
        measured: Array,
        information: Array,
        rest_by_launch: Array,
        hits: NDArray[np.int64],
    ) -> None:
        """Of n hits.

        Args:
            model: of launches by command.
            effects: that may act.
            measured: (n, 5) launches as the slides tell them.
            information: (n, 5, 5) of them.
            rest_by_launch: (n, 2, 5) derivatives of rest points.
            hits: (n,) their numbers.
        """
        super().__init__(effects)
        self.launches = model
        self.measured, self._rest, self.hits = measured, rest_by_launch, hits
        self._noise = np.asarray(np.linalg.inv(information + _NO_INFORMATION * np.eye(5)), float)

    def start(self) -> Point:
        """No effects."""
        return Point(np.empty((len(self.measured), 0)), np.empty((0, 3)))

    def drop_jumps(self, point: Point) -> None:
        """Launches have none."""

    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Parameters of the effects."""
        return [
            Column(name, p.name, -1, STEP_SHARE * p.scale)
            for name in effects
            for p in self.effects[name].parameters
        ]

    def freedom(self) -> Array:
        """(n,) expected squares of each hit."""
        encoders = self.launches.encoders
        rows = 5.0 + (0 if encoders is None else encoders.white.shape[1])
        return np.full(len(self.measured), rows)

    def starts(self, name: str) -> Sequence[Values]:
        """Every size at which an effect was simulated, one parameter at a time."""
        return self.launches.sizes(name)

    def quadratic(self, fit: Fit, effects: Sequence[str]) -> tuple[list[Column], Marginal, Array]:
        """Columns of effects at a fitted point; hits; (n, 1, 2, p) change of rest points in m."""
        columns = self.columns(effects)
        rest = self._rest @ self.launches.slopes(columns, fit.point.effects)
        return columns, self.evaluate(fit.point, columns, fit.scatter), rest[:, None]

    def shift(self, fit: Fit, name: str) -> float:
        """Root mean square change of rest points in m if one effect were absent."""
        rest = {n: v for n, v in fit.point.effects.items() if n != name}
        moved = self.launches.means(fit.point.effects) - self.launches.means(rest)
        return float(np.sqrt((np.einsum("nij,nj->ni", self._rest, moved) ** 2).sum(-1).mean()))

    def parted(self, fit: Fit, other: "LaunchFitter", rival: Fit) -> Array:
        """(n,) nats by which a hit's launch would part two fits; what encoders would say is left out."""
        mean, covariance = self.launches.predicted(fit.point.effects, fit.scatter)
        apart = mean - other.launches.means(rival.point.effects)
        return (apart * np.linalg.solve(covariance + self._noise, apart[..., None])[..., 0]).sum(1) / 2

    def evaluate(self, point: Point, columns: Sequence[Column], scatter: Array) -> Marginal:
        """Hits at a point; they have no unknowns of their own."""
        offset = self._offset(point)
        root, log_det = self.launches.roots(scatter, offset, self._noise)
        left = np.einsum("nij,nj->ni", root, offset)
        slopes = root @ self.launches.slopes(columns, point.effects)
        information = slopes.transpose(0, 2, 1) @ slopes
        scores = np.einsum("nip,ni->np", slopes, left)
        squares = (left**2).sum(1)
        read = self.launches.encoder_rows(columns, point.effects)
        if read is not None:
            residual, by_column = read
            information = information + by_column.transpose(0, 2, 1) @ by_column
            scores = scores + np.einsum("nrp,nr->np", by_column, residual)
            squares = squares + (residual**2).sum(1)
        none = np.empty((len(offset), 0))
        return Marginal(information, scores, squares, log_det, none, none[:, :, None], none[:, :, None])

    def _offset(self, point: Point) -> Array:
        """(n, 5) measured less expected."""
        return self.measured - self.launches.means(point.effects)

    def _scatter(self, point: Point, state: Marginal, before: Array) -> Array:
        return self.launches.scatter(self._offset(point), self._noise, before)


def launch_fitter(
    slides: SlideFitter, fit: Fit, model: LaunchModel, effects: Mapping[str, Effect], first_s: float = np.inf
) -> LaunchFitter:
    """Launches as fitted slides tell them, but for spin, whose prior already is what commands should give.

    Args:
        slides: fitter of the slides.
        fit: of them.
        model: of launches by command.
        effects: that may act.
        first_s: s of each slide that launches are told from. what is wrong with its law passes into
            launches the more, the longer the part of it that they are told from.
    """
    latents, covariance = fit.point.latents, fit.marginal.covariance
    if np.isfinite(first_s):
        shown = slides.valid & (slides.model.tracks.times <= first_s)
        point, covariance = told_launches(slides, fit, shown)
        latents = point.latents
    information = np.zeros((len(latents), 5, 5))
    information[:, :4, :4] = np.linalg.inv(covariance[:, :4, :4])
    _, by_latent = slides.model.by_latents(fit.point)
    last = slides.valid.sum(1) - 1
    rest = by_latent[np.arange(len(last)), last][:, :, :5]
    return LaunchFitter(model, effects, latents[:, :5], information, rest, slides.model.tracks.hit)
