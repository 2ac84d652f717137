"""Fit of a recording's hits: launches and slides, friction of all objects, and effects, in one likelihood.

Of every hit its own unknowns are the launch and a factor on friction. Frames tell them; where commands are
known, so does a prior, the launch that the command should give (see `launch`). Both are integrated out at
once, so that what acts on swing, contact, slide and camera is weighed by all that speaks of it. Camera noise
was estimated at rest; the scatter of friction and of launches from hit to hit is estimated on the way.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import FIELD, Fit, GaussNewton
from slapshot.diagnosis.pucks.fit.marginal import Marginal, marginalise
from slapshot.diagnosis.pucks.launch.launch_prior import LAUNCH, NEARLY_FLAT, SPIN, LaunchPrior, UnknownLaunch
from slapshot.diagnosis.pucks.launch.swing_error import LATENESS, with_errors
from slapshot.diagnosis.pucks.slide.first_guess import first_guess
from slapshot.diagnosis.pucks.slide.noise import CameraNoise, frame_speeds, leaps, outliers
from slapshot.diagnosis.pucks.slide.slide_model import LATENTS, Column, Effects, Point, SlideModel, Values

SHOWN = 4  # frames that stand for a track where its shift is told
NEAR = 0.3  # of a parameter's scale, within which derivatives by fields are taken for the same
FIRST_FRICTION_SD = 0.03
FRICTION_SD = (0.002, 0.3)  # bounds of the scatter of log friction from hit to hit
# m, m/s, rad/s and log friction: of a hit's own unknowns, within an iteration and at all.
LARGEST_STEP = np.array([0.1, 0.1, 0.5, 0.5, 5.0, 0.3])
LARGEST_LATENT = np.array([20.0, 20.0, 8.0, 8.0, 60.0, 1.5])
FRICTION = LATENTS.index("log_friction")
_NO_INFORMATION = 1e-6  # keeps what a slide does not tell (spin) from being singular


@dataclass(frozen=True)
class Scatter:
    """From hit to hit.

    Attributes:
        friction: sd of log friction.
        launch: (5, 5) covariance of launches in the frame of their heading; (0, 0) where commands are not
            known.
    """

    friction: float
    launch: Array


class HitFitter(GaussNewton):
    """Fits one set of hits; frames that jump are left out."""

    iterations = 40

    def __init__(self, model: SlideModel, noise: CameraNoise, launches: LaunchPrior | None = None) -> None:
        super().__init__(model.effects)
        self.model, self.noise = model, noise
        self.launches = launches or UnknownLaunch(len(model.tracks))
        self.valid = model.tracks.valid.copy()
        self.frame_sd = self._frame_sd()
        self._wide: tuple[list[tuple[str, str]], Array, Array] | None = None
        self._at: tuple[Point, list[Column], tuple[Array, Array, Array]] | None = None
        tracks = model.tracks
        self._drop(leaps(tracks.times, tracks.places, self.valid, noise.sd))

    @property
    def first_scatter(self) -> Scatter:
        """Before it is estimated."""
        return Scatter(FIRST_FRICTION_SD, self.launches.first_scatter)

    def start(self) -> Point:
        """Launches from the first frames, friction from how far the object went."""
        point = first_guess(self.model.tracks)
        tracks = self.model.tracks
        seen = np.isfinite(tracks.spin_sd)
        point.latents[:, SPIN] = np.where(seen, tracks.spin, self.launches.simulated_spin(point)[0])
        return point

    def about(self, launches: LaunchPrior) -> "HitFitter":
        """The same frames with another prior of launches."""
        other = copy(self)
        other.launches = launches
        tracks = self.model.tracks
        if launches.turned is not None:
            turned = np.where(tracks.turn_seen, tracks.turned, launches.turned)
            if not np.array_equal(turned, tracks.turned):
                other.model = self.model.of(replace(tracks, turned=turned))
                other._at = other._wide = None
        return other

    def slides_alone(self, point: Point, shown: NDArray[np.bool_] | None = None) -> "HitFitter":
        """The frames shown (n, frames), or all, of hits of whose launches nothing is known but the spin."""
        other = self.about(UnknownLaunch(len(point.latents), *self.launches.simulated_spin(point)))
        other.valid = self.valid if shown is None else shown
        return other

    def drop_jumps(self, point: Point) -> None:
        """Leave mistracked frames out from now on."""
        left = self.model.tracks.places - self.model.predict(point)
        self._drop(outliers(left, self.valid, self.frame_sd))

    def _drop(self, jump: NDArray[np.bool_]) -> None:
        """Move frames behind the valid ones of their hit."""
        tracks = self.model.tracks
        keep = self.valid & ~jump
        order = np.argsort(~keep, axis=1, kind="stable")
        rows = np.arange(len(tracks))[:, None]
        self.valid = keep[rows, order]
        tracks = replace(tracks, times=tracks.times[rows, order], places=tracks.places[rows, order])
        self.model.tracks = replace(tracks, valid=self.valid)
        self._at = self._wide = None
        self.frame_sd = self._frame_sd()

    def _frame_sd(self) -> Array:
        """(n, frames) m."""
        tracks = self.model.tracks
        return self.noise.sd_at(frame_speeds(tracks.times, tracks.places, tracks.valid))

    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Nuisance of all objects, then the parameters of the effects."""
        return self.model.columns(effects)

    def acting(self, effects: Sequence[str]) -> Sequence[str]:
        """With errors of laws of the swing, where anything is known of launches."""
        return with_errors(self.effects, effects) if self.launches.sizes(LATENESS) else effects

    def starts(self, name: str) -> Sequence[Values]:
        """Every size at which an effect was simulated, one parameter at a time."""
        return self.launches.sizes(name)

    def start_misfit(self, fit: Fit, values: Effects) -> float:
        """What launches alone make of a fit's objective under other effects, its slides being what they are.

        Slides tell launches of their own; a swing or a contact is not linear, so that it is looked at far
        from the fit where a step of Gauss and Newton would begin.
        """
        assert fit.marginal.told is not None
        return self.launches.misfit(
            replace(fit.point, effects=values), *fit.marginal.told, fit.scatter.launch
        )

    def quadratic(self, fit: Fit, effects: Sequence[str]) -> tuple[list[Column], Marginal, Array]:
        """Columns of nuisance and effects at a fitted point.

        Returns:
            The columns; hits marginalised over them; (n, SHOWN, 2, p) change in m of some frames of each
            hit, the last among them, the launch being what it is but for what its command should change.
        """
        errors = [LATENESS] if LATENESS in fit.point.effects else []
        columns = self.columns([*effects, *errors])
        predicted, by_latent, by_column = self.model.derivatives(fit.point, columns)
        frames = self._some_frames()
        by_launch = self.launches.slopes(columns, fit.point)[:, None]
        moved = by_column[frames] + by_latent[frames][..., :LAUNCH] @ by_launch
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

    def gain_by_tracks(self, fit: Fit, name: str) -> float:
        """See `fitter.Fitter`."""
        alone = self.about(UnknownLaunch(len(fit.point.latents)))
        scatter = Scatter(fit.scatter.friction, alone.launches.first_scatter)
        without = [n for n in fit.point.effects if n != name]
        few, all_of_them = (alone.fit(fit.point, scatter, effects) for effects in (without, [*without, name]))
        return (few.objective - all_of_them.objective) / 2

    def gain_by_encoders(self, fit: Fit, name: str) -> float:
        """See `fitter.Fitter`."""
        effects = {n: values for n, values in fit.point.effects.items() if n != name}
        read = [
            self.launches.encoder_rows([], point)
            for point in (replace(fit.point, effects=effects), fit.point)
        ]
        few, all_of_them = (0.0 if rows is None else float((rows[0] ** 2).sum()) for rows in read)
        return (few - all_of_them) / 2

    def _moved_by(self, fit: Fit, name: str) -> Array:
        point = fit.point
        without = replace(point, effects={n: v for n, v in point.effects.items() if n != name})
        latents = point.latents.copy()
        latents[:, :LAUNCH] += self.launches.offsets(without) - self.launches.offsets(point)
        moved = self.model.predict(point) - self.model.predict(replace(without, latents=latents))
        return moved[self._some_frames()]

    def freedom(self) -> Array:
        """(n,) expected squares of each hit: its data less what fits its own unknowns."""
        return 2.0 * self.valid.sum(1) + np.isfinite(self.model.tracks.spin_sd) + self.launches.rows

    def evaluate(
        self,
        point: Point,
        columns: Sequence[Column],
        scatter: Scatter,
    ) -> Marginal:
        """Hits marginalised at a point."""
        if self._at is None or self._at[0] is not point or self._at[1] != list(columns):
            # The same point is looked at once more with another scatter.
            self._at = point, list(columns), self._derivatives(point, columns)
        return self._marginal(point, columns, *self._at[2], scatter)

    def _derivatives(self, point: Point, columns: Sequence[Column]) -> tuple[Array, Array, Array]:
        """Those of the model; of fields, which are nearly linear and dear, those of a point nearby."""
        wide = [
            c
            for c, column in enumerate(columns)
            if column.object < 0 and len(self.effects[column.owner].parameters) > FIELD
        ]
        if not wide:
            return self.model.derivatives(point, columns)
        names = [(columns[c].owner, columns[c].parameter) for c in wide]
        values = np.array([point.effects[owner][parameter] for owner, parameter in names])
        # Of fields as large as the recording asks for.
        scales = np.array(
            [self._parameter(columns[c]).scale * self.sizes.get(columns[c].owner, 1.0) for c in wide]
        )
        kept = self._wide
        if kept is None or kept[0] != names or np.any(np.abs(values - kept[1]) > NEAR * scales):
            found = self.model.derivatives(point, columns)
            self._wide = names, values, found[2][..., wide]
            return found
        narrow = [c for c in range(len(columns)) if c not in set(wide)]
        predicted, by_latent, some = self.model.derivatives(point, [columns[c] for c in narrow])
        by_column = np.empty((*predicted.shape, len(columns)))
        by_column[..., narrow], by_column[..., wide] = some, kept[2]
        return predicted, by_latent, by_column

    def _marginal(
        self,
        point: Point,
        columns: Sequence[Column],
        predicted: Array,
        by_latent: Array,
        by_column: Array,
        scatter: Scatter,
    ) -> Marginal:
        z, h, j = self._whitened(predicted, by_latent, by_column)
        z, h, j = self._with_spins(point, z, h, j)
        measured, noise = _told_by_slides(point, z, h, scatter.friction)
        count, size = point.latents.shape
        offset, root = np.zeros((count, size)), np.zeros((count, size, size))
        offset[:, :LAUNCH] = self.launches.offsets(point)
        offset[:, FRICTION] = -point.latents[:, FRICTION]
        launch_root, log_det = self.launches.roots(scatter.launch, offset[:, :LAUNCH] - measured, noise)
        root[:, :LAUNCH, :LAUNCH], root[:, FRICTION, FRICTION] = launch_root, 1 / scatter.friction
        by_prior = np.zeros((count, size, j.shape[-1]))
        by_prior[:, :LAUNCH] = self.launches.slopes(columns, point)
        marginal = marginalise(z, h, j, offset, root, by_prior)
        volume = marginal.log_volume + log_det + 2 * np.log(scatter.friction) - self._flat_volume(h)
        told = point.latents[:, :LAUNCH] + measured, noise
        marginal = replace(marginal, log_volume=volume, told=told)
        read = self.launches.encoder_rows(columns, point)
        return marginal if read is None else with_readings(marginal, *read)

    def _flat_volume(self, by_latent: Array) -> Array | float:
        """(n,) log det of the information on what a launch's prior says nothing about.

        Such a prior is flat in what the camera sees, not in metres: else a camera that shrinks places would
        seem likelier, since more launches then lead to what was seen.
        """
        flat = self.launches.flat
        if not flat:
            return 0.0
        seen = by_latent[..., :flat]
        information = seen.transpose(0, 2, 1) @ seen + NEARLY_FLAT**2 * np.eye(flat)
        return np.asarray(np.linalg.slogdet(information)[1])

    def _whitened(self, predicted: Array, by_latent: Array, by_column: Array) -> tuple[Array, Array, Array]:
        """Residuals of frames (n, rows), and derivatives by latents (n, rows, 6) and columns (n, rows, p)."""
        tracks, count = self.model.tracks, len(predicted)
        parts = tracks.places - predicted, by_latent, by_column
        z, h, j = (self.noise.whiten(part, tracks.times, self.valid, self.frame_sd) for part in parts)
        return (
            z.reshape(count, -1),
            h.reshape(count, -1, h.shape[-1]),
            j.reshape(count, -1, j.shape[-1]) if (j.shape[-1]) else np.zeros((count, z[0].size, 0)),
        )

    def _with_spins(self, point: Point, z: Array, h: Array, j: Array) -> tuple[Array, Array, Array]:
        """Rows of frames, and one of the spin that yaw tells; of hits whose yaw nobody saw it is 0."""
        tracks = self.model.tracks
        if not np.isfinite(tracks.spin_sd).any():
            return z, h, j
        by_spin = np.zeros((len(z), 1, h.shape[-1]))
        by_spin[:, 0, SPIN] = 1 / tracks.spin_sd
        left = ((tracks.spin - point.latents[:, SPIN]) / tracks.spin_sd)[:, None]
        none = np.zeros((len(z), 1, j.shape[-1]))
        return (
            np.concatenate([z, left], axis=1),
            np.concatenate([h, by_spin], axis=1),
            np.concatenate([j, none], axis=1),
        )

    def _scatter(self, point: Point, state: Marginal, before: Scatter) -> Scatter:
        square = (point.latents[:, FRICTION] ** 2 + state.covariance[:, FRICTION, FRICTION]).mean()
        assert state.told is not None
        launch = self.launches.scatter(point, *state.told, before.launch)
        return Scatter(float(np.clip(np.sqrt(square), *FRICTION_SD)), launch)

    def _moved_latents(self, point: Point, shift: Array, state: Marginal, trust: Array) -> Array:
        return bounded_step(point.latents, trust[:, None] * state.step + state.gain @ shift)


def with_readings(marginal: Marginal, residual: Array, by_shared: Array) -> Marginal:
    """Hits with whitened readings beside: residuals (n, rows), and derivatives (n, rows, p)."""
    # Most columns are of the slide, which encoders do not see.
    seen = np.flatnonzero(by_shared.any(axis=(0, 1)))
    by_seen = by_shared[..., seen]
    information, scores = marginal.information.copy(), marginal.scores.copy()
    information[:, seen[:, None], seen] += by_seen.transpose(0, 2, 1) @ by_seen
    scores[:, seen] += np.einsum("nrp,nr->np", by_seen, residual)
    squares = marginal.squares + (residual**2).sum(1)
    return replace(marginal, information=information, scores=scores, squares=squares)


def _told_by_slides(point: Point, z: Array, h: Array, friction_sd: float) -> tuple[Array, Array]:
    """(n, 5) by which whitened residuals z (n, rows) would change launches, and its covariance (n, 5, 5)."""
    information = h.transpose(0, 2, 1) @ h + _NO_INFORMATION * np.eye(h.shape[-1])
    information[:, FRICTION, FRICTION] += friction_sd**-2
    pull = np.einsum("nru,nr->nu", h, z)
    pull[:, FRICTION] -= point.latents[:, FRICTION] * friction_sd**-2
    covariance = np.asarray(np.linalg.inv(information), float)
    return np.einsum("nuv,nv->nu", covariance, pull)[:, :LAUNCH], covariance[:, :LAUNCH, :LAUNCH]


def bounded_step(latents: Array, step: Array) -> Array:
    """Latents (n, 6) after a step of Gauss-Newton, which may be far too long where little is known."""
    step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
    return np.clip(latents + step, -LARGEST_LATENT, LARGEST_LATENT)
