"""Damped Gauss-Newton on a marginal likelihood: what fitters of slides, launches and rest points share."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.selection.evidence import LARGEST, project
from slapshot.diagnosis.pucks.slide.first_guess import NUISANCE_MEAN
from slapshot.diagnosis.pucks.slide.slide_model import Column, Point
from slapshot.effects.effect import ARM_JOINTS, Effect, Parameter

CONVERGED = 0.02  # of the objective (nats): differences that matter are of order 1
# Parameters; effects with more, than one for each joint, get a prior of the size that the recording asks for.
FIELD = ARM_JOINTS
WORSE = 1.0  # of the objective, which a step may be
# A fit whose objective stays within so little over so many steps only goes to and fro: it has arrived.
TO_AND_FRO, PATIENCE = 1.0, 4
# So has one that no longer falls and stays within this share of it, as where launches are hardly told.
WAVERS = 1e-4
MOST_DAMPING = 1e4
DISTRUST = 0.25  # by which the steps of a hit shorten that made it worse
# Of logarithms of mu_x, mu_y and of the torsional friction in m.
NUISANCE_SD = np.array([1.0, 1.0, 1.0])
# Torsional friction reaches no farther than the contact is wide.
NUISANCE_BOUNDS = np.log([[0.01, 3.0], [0.01, 3.0], [1e-5, 0.1]])


@dataclass(frozen=True)
class Fit:
    """A fitted recording.

    Attributes:
        point: latents, nuisance and effects.
        scatter: from hit to hit: see `hit_fit.Scatter`; of rest points alone a (2, 2) covariance over the
            distance.
        objective: -2 log marginal likelihood minus constants; lower is better.
        columns: of `covariance` and `marginal`.
        covariance: (p, p) of the shared parameters.
        marginal: at the point.
        dispersion: of whitened residuals, 1 where the model holds.
        converged: whether it did.
    """

    point: Point
    scatter: Any
    objective: float
    columns: tuple[Column, ...]
    covariance: Array
    marginal: Marginal
    dispersion: float
    converged: bool


class GaussNewton(ABC):
    """Fits shared parameters and the scatter of hits.

    The scatter is estimated on the way (expectation maximisation), never assumed.
    """

    iterations: int

    @property
    @abstractmethod
    def first_scatter(self) -> Any:
        """What hits scatter by before it is estimated."""

    def __init__(self, effects: Mapping[str, Effect]) -> None:
        self.effects = effects
        self.sizes: dict[str, float] = {}

    @abstractmethod
    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Shared parameters: nuisance, three of each object, then those of the effects."""

    def acting(self, effects: Sequence[str]) -> Sequence[str]:
        """The effects of a fit, and errors of their laws that are fitted with them."""
        return effects

    @abstractmethod
    def evaluate(self, point: Point, columns: Sequence[Column], scatter: Any) -> Marginal:
        """Hits marginalised at a point."""

    @abstractmethod
    def freedom(self) -> Array:
        """(n,) expected squares of each hit."""

    @abstractmethod
    def _scatter(self, point: Point, state: Marginal, before: Any) -> Any:
        """What hits scatter by at a point."""

    def fit(self, start: Point, scatter: Any = None, effects: Sequence[str] = ()) -> Fit:
        """Fit nuisance, scatter and the effects named, from a point."""
        effects = self.acting(effects)
        point = replace(
            start, effects={n: dict(start.effects.get(n, self.effects[n].neutral())) for n in effects}
        )
        columns = self.columns(effects)
        mean, precision = self.prior(columns)
        scatter = self.first_scatter if scatter is None else scatter
        damping, converged = 1e-3, False
        state = self.evaluate(point, columns, scatter)
        trust = np.ones(len(state.squares))
        objective = self._objective(state, point, columns)
        passed = [objective]
        lowest = objective, point, scatter, state  # of those that passed
        for _ in range(self.iterations):
            information = state.information.sum(0) + np.diag(precision)
            score = state.scores.sum(0) + precision * (mean - shared(point, columns))
            shift = self._step(information + damping * np.diag(np.diag(information)), score, point, columns)
            new = self._moved(point, columns, shift, state, trust)
            candidate = self.evaluate(new, columns, scatter)
            # A hit whose own unknowns went too far is one of many, and does not show in the sum.
            worse = candidate.squares + candidate.log_volume > state.squares + state.log_volume + CONVERGED
            trust = np.where(worse, trust * DISTRUST, np.minimum(trust / np.sqrt(DISTRUST), 1.0))
            value = self._objective(candidate, new, columns)
            # Wild hits change their weights with every step, which may raise the objective a little.
            if value > objective + WORSE and damping < MOST_DAMPING:
                damping *= 100
                continue
            damping, before = max(damping / 10, 1e-6), objective
            spread = self._scatter(new, candidate, scatter)
            point, scatter, state = new, spread, self.evaluate(new, columns, spread)
            objective = self._objective(state, point, columns)
            passed = [*passed[-PATIENCE:], objective]
            extent = max(passed) - min(passed) if len(passed) > PATIENCE else np.inf
            arrived = extent < TO_AND_FRO
            if objective <= min(passed):
                lowest = objective, point, scatter, state
            elif extent < WAVERS * abs(objective) and lowest[0] in passed:
                objective, point, scatter, state = lowest
                arrived = True
            if max(abs(objective - before), abs(value - before)) < CONVERGED or arrived:
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

    def _step(self, information: Array, score: Array, point: Point, columns: Sequence[Column]) -> Array:
        """(p,) Newton's step of shared parameters; those at a bound that it would leave stay there."""
        low, high = self._bounds(columns)
        values = shared(point, columns)
        free = np.ones(len(columns), bool)
        while True:
            shift = np.zeros(len(columns))
            shift[free] = np.linalg.solve(information[np.ix_(free, free)], score[free])
            leaves = free & (((values <= low) & (shift < 0)) | ((values >= high) & (shift > 0)))
            if not leaves.any():
                return shift
            free &= ~leaves

    def _bounds(self, columns: Sequence[Column]) -> tuple[Array, Array]:
        """(p,), (p,) of the shared parameters."""
        bounds = [
            NUISANCE_BOUNDS[c % 3]
            if column.object >= 0
            else (self._parameter(column).low, self._parameter(column).high)
            for c, column in enumerate(columns)
        ]
        low, high = np.array(bounds).reshape(-1, 2).T
        return low, high

    @abstractmethod
    def quadratic(self, fit: Fit, effects: Sequence[str]) -> tuple[list[Column], Marginal, Array]:
        """See `fitter.Fitter`."""

    @abstractmethod
    def _moved_by(self, fit: Fit, name: str) -> Array:
        """(n, frames, 2) m by which an effect of a fit moves those frames that `quadratic` shows."""

    def shift(self, fit: Fit, name: str) -> float:
        """See `fitter.Fitter`."""
        neutral, values = self.effects[name].neutral(), fit.point.effects[name]
        nuisance = np.array([c for c, column in enumerate(fit.columns) if column.object >= 0], np.int64)
        own = np.array([c for c, column in enumerate(fit.columns) if column.owner == name], np.int64)
        both = np.concatenate([nuisance, own])
        _, precision = self.prior([fit.columns[c] for c in nuisance])
        weights = project(
            fit.marginal.information.sum(0)[np.ix_(both, both)],
            fit.marginal.scores[:, both],
            np.arange(len(nuisance)),
            np.diag(precision),
        ).weights
        parameters = [fit.columns[c].parameter for c in own]
        compensation = weights @ np.array([values[p] - neutral[p] for p in parameters])
        columns, _, by_column = self.quadratic(fit, [])
        by_friction = by_column[..., [c for c, column in enumerate(columns) if column.object >= 0]]
        moved = self._moved_by(fit, name) - by_friction @ compensation
        return float(np.sqrt((moved**2).sum(-1).mean(0).max()))

    def prior(self, columns: Sequence[Column]) -> tuple[Array, Array]:
        """Mean and information (p,) of the shared parameters."""
        mean, precision = np.zeros(len(columns)), np.zeros(len(columns))
        for c, column in enumerate(columns):
            if column.object >= 0:
                which = c % 3
                mean[c], precision[c] = NUISANCE_MEAN[which], NUISANCE_SD[which] ** -2
            else:
                p = self._parameter(column)
                mean[c] = p.neutral
                precision[c] = (self.sizes.get(column.owner, LARGEST) * p.scale) ** -2
        return mean, precision

    def _objective(self, state: Marginal, point: Point, columns: Sequence[Column]) -> float:
        """At the present latents' best first-order change: squares, volume and prior."""
        mean, precision = self.prior(columns)
        prior = float((precision * (shared(point, columns) - mean) ** 2).sum())
        return float(state.squares.sum() + state.log_volume.sum()) + prior

    def _moved(
        self, point: Point, columns: Sequence[Column], shift: Array, state: Marginal, trust: Array
    ) -> Point:
        nuisance = point.nuisance.copy()
        effects = {name: dict(values) for name, values in point.effects.items()}
        for c, column in enumerate(columns):
            if column.object >= 0:
                value = nuisance[column.object, c % 3] + shift[c]
                nuisance[column.object, c % 3] = np.clip(value, *NUISANCE_BOUNDS[c % 3])
            else:
                p = self._parameter(column)
                value = effects[column.owner][column.parameter] + shift[c]
                effects[column.owner][column.parameter] = float(np.clip(value, p.low, p.high))
        return Point(self._moved_latents(point, shift, state, trust), nuisance, effects)

    def _moved_latents(self, point: Point, shift: Array, state: Marginal, trust: Array) -> Array:
        """A hit's own unknowns after a step of the shared parameters; where there are none, none move.

        Of the step that they would take by themselves they take a share, `trust` (n,).
        """
        return point.latents

    def _parameter(self, column: Column) -> Parameter:
        return next(p for p in self.effects[column.owner].parameters if p.name == column.parameter)


def shared(point: Point, columns: Sequence[Column]) -> Array:
    """(p,) values of shared parameters at a point."""
    values = np.empty(len(columns))
    for c, column in enumerate(columns):
        if column.object >= 0:
            values[c] = point.nuisance[column.object, c % 3]
        else:
            values[c] = point.effects[column.owner][column.parameter]
    return values
