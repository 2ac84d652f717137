"""Fit of a recording's launches: what its slides say of each launch against what its command should give.

The slides were fitted before, each with a launch of its own. Their posterior is a measurement of the launch,
with a covariance of its own; where it differs from the command's by more than launches scatter, swing,
contact or camera lacks something. No slide is simulated here, so that all effects are fitted in a moment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.evidence import LARGEST
from slapshot.diagnosis.launch import FIRST_SD, LaunchModel
from slapshot.diagnosis.marginal import Marginal
from slapshot.diagnosis.slide_fit import Fit, SlideFitter, parameter_of
from slapshot.diagnosis.slide_model import STEP_SHARE, Column, Point, Values
from slapshot.diagnosis.told import told_launches
from slapshot.effects.effect import Effect

Array = NDArray[np.float64]

ITERATIONS = 40
CONVERGED = 0.02
_NO_INFORMATION = 1e-6  # keeps the information of what a slide does not tell (spin) from being singular


class LaunchFitter:
    """Fits the launches of n hits."""

    def __init__(
        self,
        model: LaunchModel,
        effects: Mapping[str, Effect],
        measured: Array,
        information: Array,
        rest_by_launch: Array,
    ) -> None:
        """Of n hits.

        Args:
            model: of launches by command.
            effects: that may act.
            measured: (n, 5) launches as the slides tell them.
            information: (n, 5, 5) of them.
            rest_by_launch: (n, 2, 5) derivatives of rest points.
        """
        self.launches, self.effects = model, effects
        self.measured, self._rest = measured, rest_by_launch
        self.sizes: dict[str, float] = {}
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

    def prior(self, columns: Sequence[Column]) -> tuple[Array, Array]:
        """Mean and information (p,) of the parameters."""
        found = [parameter_of(self.effects[c.owner].parameters, c.parameter) for c in columns]
        return np.array([p.neutral for p in found]), np.array(
            [(self.sizes.get(c.owner, LARGEST) * p.scale) ** -2 for c, p in zip(columns, found, strict=True)]
        )

    def fit(self, start: Point, scatter: Array | None = None, effects: Sequence[str] = ()) -> Fit:
        """Fit the effects named and the scatter of launches, from a point."""
        point = replace(
            start, effects={n: dict(start.effects.get(n, self.effects[n].neutral())) for n in effects}
        )
        columns = self.columns(effects)
        mean, precision = self.prior(columns)
        scatter = np.diag(FIRST_SD**2) if scatter is None else scatter
        damping, converged = 1e-3, False
        state = self.evaluate(point, columns, scatter)
        objective = self._objective(state, point, columns, mean, precision)
        for _ in range(ITERATIONS):
            information = state.information.sum(0) + np.diag(precision)
            score = state.scores.sum(0) + precision * (mean - _values(point, columns))
            shift = np.linalg.solve(information + damping * np.diag(np.diag(information)), score)
            new = self._moved(point, columns, shift)
            spread = self.launches.scatter(self._offset(new), self._noise, scatter)
            candidate = self.evaluate(new, columns, spread)
            value = self._objective(candidate, new, columns, mean, precision)
            if value > objective + 1.0 and damping < 1e6:
                damping *= 10
                continue
            change, damping = objective - value, max(damping / 5, 1e-6)
            point, state, objective, scatter = new, candidate, value, spread
            if abs(change) < CONVERGED:
                converged = True
                break
        information = state.information.sum(0) + np.diag(precision)
        return Fit(
            point,
            scatter,
            objective,
            tuple(columns),
            np.linalg.inv(information) if columns else np.empty((0, 0)),
            state,
            float(state.squares.sum() / max(self.freedom().sum(), 1)),
            converged,
        )

    def freedom(self) -> Array:
        """(n,) expected squares of each hit."""
        encoders = self.launches.encoders
        rows = 5.0 + (0 if encoders is None else encoders.white.shape[1])
        return np.full(len(self.measured), rows)

    def starts(self, name: str) -> Sequence[Values]:
        """Every size at which an effect was simulated, one parameter at a time."""
        return self.launches.sizes(name)

    def objective(self, point: Point, scatter: Array, effects: Sequence[str]) -> float:
        """At a point."""
        columns = self.columns(effects)
        return self._objective(self.evaluate(point, columns, scatter), point, columns, *self.prior(columns))

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

    @staticmethod
    def _objective(
        state: Marginal, point: Point, columns: Sequence[Column], mean: Array, precision: Array
    ) -> float:
        prior = float((precision * (_values(point, columns) - mean) ** 2).sum())
        return float(state.squares.sum() + state.log_volume.sum()) + prior

    def _moved(self, point: Point, columns: Sequence[Column], shift: Array) -> Point:
        effects: dict[str, dict[str, float]] = {n: dict(v) for n, v in point.effects.items()}
        for column, change in zip(columns, shift, strict=True):
            p = parameter_of(self.effects[column.owner].parameters, column.parameter)
            value = effects[column.owner][column.parameter] + float(change)
            effects[column.owner][column.parameter] = float(np.clip(value, p.low, p.high))
        return replace(point, effects=effects)


def _values(point: Point, columns: Sequence[Column]) -> Array:
    effects: Mapping[str, Values] = point.effects
    return np.array([effects[c.owner][c.parameter] for c in columns], float)


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
    return LaunchFitter(model, effects, latents[:, :5], information, rest)
