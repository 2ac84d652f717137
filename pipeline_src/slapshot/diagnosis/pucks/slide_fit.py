"""Fit of a recording's slides: launches of all hits, friction of all objects, and effects, at once.

Camera noise was estimated at rest; the scatter of friction from hit to hit is estimated on the way.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.first_guess import first_guess
from slapshot.diagnosis.pucks.gauss_newton import Fit, GaussNewton
from slapshot.diagnosis.pucks.marginal import Marginal, marginalise
from slapshot.diagnosis.pucks.noise import CameraNoise, frame_speeds, leaps, outliers
from slapshot.diagnosis.pucks.slide_model import Column, Point, SlideModel, Values
from slapshot.diagnosis.pucks.spin import SpinPrior, UnknownSpin

SHOWN = 4  # frames that stand for a track where its shift is told
NEARLY_FLAT = (
    0.1,
    0.1,
    0.1,
    0.1,
)  # 1/m and s/m: nothing beside a frame, but a hit that does not move has one
FIRST_FRICTION_SD = 0.03
FRICTION_SD = (0.002, 0.3)  # bounds of the scatter of log friction from hit to hit
# m, m/s, rad/s and log friction: of a hit's own unknowns, within an iteration and at all.
LARGEST_STEP = np.array([0.1, 0.1, 0.5, 0.5, 5.0, 0.3])
LARGEST_LATENT = np.array([20.0, 20.0, 8.0, 8.0, 60.0, 1.5])


class SlideFitter(GaussNewton):
    """Fits one set of hits; frames that jump are left out."""

    iterations = 20
    first_scatter = FIRST_FRICTION_SD

    def __init__(self, model: SlideModel, noise: CameraNoise, spin: SpinPrior | None = None) -> None:
        super().__init__(model.effects)
        self.model, self.noise = model, noise
        self.spin = spin or UnknownSpin(len(model.tracks))
        self.valid = model.tracks.valid.copy()
        self.frame_sd = self._frame_sd()

    def start(self) -> Point:
        """Launches from the first frames, friction from how far the object went."""
        self._drop(leaps(self.model.tracks.places, self.valid, self.noise.sd))
        return first_guess(self.model.tracks, self.spin.means({}))

    def drop_jumps(self, point: Point) -> None:
        """Leave mistracked frames out from now on."""
        left = self.model.tracks.places - self.model.predict(point)
        self._drop(outliers(left, self.valid, self.noise.sd))

    def _drop(self, jump: NDArray[np.bool_]) -> None:
        """Move frames behind the valid ones of their hit."""
        tracks = self.model.tracks
        keep = self.valid & ~jump
        order = np.argsort(~keep, axis=1, kind="stable")
        rows = np.arange(len(tracks))[:, None]
        self.valid = keep[rows, order]
        tracks = replace(tracks, times=tracks.times[rows, order], places=tracks.places[rows, order])
        self.model.tracks = replace(tracks, valid=self.valid)
        self.frame_sd = self._frame_sd()

    def _frame_sd(self) -> Array:
        """(n, frames) m."""
        tracks = self.model.tracks
        return self.noise.sd_at(frame_speeds(tracks.times, tracks.places, tracks.valid))

    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Nuisance of all objects, then the parameters of the effects."""
        return self.model.columns(effects)

    def starts(self, name: str) -> Sequence[Values]:
        """None: slides are nearly linear in all effects."""
        return ()

    def quadratic(self, fit: Fit, effects: Sequence[str]) -> tuple[list[Column], Marginal, Array]:
        """Columns of nuisance and effects at a fitted point.

        Returns:
            The columns; hits marginalised over them; (n, SHOWN, 2, p) change in m of some frames of each
            hit, the last among them, its launch being what it is.
        """
        columns = self.model.columns(effects)
        predicted, by_latent, by_column = self.model.derivatives(fit.point, columns)
        moved = by_column[self._some_frames()]
        return (
            columns,
            self._marginal(fit.point, columns, predicted, by_latent, by_column, fit.scatter),
            moved,
        )

    def _some_frames(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Hits and frames (n, SHOWN) that stand for a track."""
        last = self.valid.sum(1) - 1
        frames = np.round(last[:, None] * np.arange(1, SHOWN + 1) / SHOWN).astype(np.int64)
        return np.arange(len(last))[:, None], frames

    def shift(self, fit: Fit, name: str) -> float:
        """Root mean square change of tracks in m if one effect were absent, launches given."""
        point = fit.point
        without = replace(point, effects={n: v for n, v in point.effects.items() if n != name})
        moved = self.model.predict(point) - self.model.predict(without)
        return float(np.sqrt((moved[self._some_frames()] ** 2).sum(-1).mean(0).max()))

    def freedom(self) -> Array:
        """(n,) expected squares of each hit: its data less what fits its own unknowns."""
        return 2.0 * self.valid.sum(1) - 4

    def evaluate(
        self,
        point: Point,
        columns: Sequence[Column],
        scatter: float,
        shown: NDArray[np.bool_] | None = None,
    ) -> Marginal:
        """Hits marginalised at a point, from all frames or from those shown (n, frames)."""
        return self._marginal(point, columns, *self.model.derivatives(point, columns), scatter, shown)

    def _marginal(
        self,
        point: Point,
        columns: Sequence[Column],
        predicted: Array,
        by_latent: Array,
        by_column: Array,
        scatter: float,
        shown: NDArray[np.bool_] | None = None,
    ) -> Marginal:
        tracks, count = self.model.tracks, len(point.latents)
        times, valid = tracks.times, self.valid if shown is None else shown
        z = self.noise.whiten(tracks.places - predicted, times, valid, self.frame_sd)
        h = self.noise.whiten(by_latent, times, valid, self.frame_sd)
        j = self.noise.whiten(by_column, times, valid, self.frame_sd)
        offset = np.zeros_like(point.latents)
        offset[:, 4:] = -point.latents[:, 4:]
        offset[:, 4] += self.spin.means(point.effects)
        by_prior = np.zeros((count, 6, len(columns)))
        by_prior[:, 4] = self.spin.slopes(columns, point.effects)
        root = np.diag([*NEARLY_FLAT, 1 / self.spin.sd, 1 / scatter])
        rows = z.shape[1] * z.shape[2]
        marginal = marginalise(
            z.reshape(count, rows),
            h.reshape(count, rows, h.shape[-1]),
            j.reshape(count, rows, j.shape[-1]),
            offset,
            root,
            by_prior,
        )
        return replace(marginal, log_volume=marginal.log_volume + 2 * np.log(scatter))

    def _scatter(self, point: Point, state: Marginal, before: float) -> float:
        square = (point.latents[:, 5] ** 2 + state.covariance[:, 5, 5]).mean()
        return float(np.clip(np.sqrt(square), *FRICTION_SD))

    def _moved_latents(self, point: Point, shift: Array, state: Marginal) -> Array:
        return bounded_step(point.latents, state.step + state.gain @ shift)


def bounded_step(latents: Array, step: Array) -> Array:
    """Latents (n, 6) after a step of Gauss-Newton, which may be far too long where little is known."""
    step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
    return np.clip(latents + step, -LARGEST_LATENT, LARGEST_LATENT)
