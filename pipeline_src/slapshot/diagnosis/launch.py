"""Where and how fast every object should be at its release, given its command, encoders, and effects.

The launch (x, y, vx, vy, spin) of hit i has a Gaussian prior: the simulated launch of its command with the
object where the camera saw it lie, corrected by how the encoders say the arm moved, and by effects, with a
scatter that hits share, in the frame of their heading. Encoders add evidence of their own on effects that
they see.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from slapshot.diagnosis.execution import Execution, Readings, pace_matrix
from slapshot.diagnosis.free_form import launch_features
from slapshot.diagnosis.signatures import LOOK, Signatures
from slapshot.diagnosis.slide_model import Column, Values
from slapshot.effects.effect import Effect

Array = NDArray[np.float64]

LEAST_SD = np.array([5e-4, 5e-4, 5e-3, 5e-3, 0.1])  # m, m/s, rad/s: contact is no better known than that
FIRST_SD = np.array([0.02, 0.02, 0.15, 0.15, 2.0])
SHORT = 1e-3  # s
DECELERATION = 3.5  # m/s^2, typical of dry friction
TAILS = 6.0  # degrees of freedom of a launch: some hits go wrong


@dataclass(frozen=True)
class Encoders:
    """What encoders say of n hits beyond the nominal swing.

    Attributes:
        execution: with the residuals of the encoders.
        white: (n, rows) of those residuals.
        changes: effect/parameter -> (v, n, rows) of the changes at the signature's values.
    """

    execution: Execution
    white: Array
    changes: Mapping[str, PchipInterpolator]


class LaunchModel:
    """Prior of the launches of n hits."""

    def __init__(
        self,
        signatures: Signatures,
        rows: NDArray[np.int64],
        simulated: Array,
        releases: Array,
        effects: Mapping[str, Effect],
        camera: Array,
        starts: Array,
        readings: Readings | None,
    ) -> None:
        """Of n hits.

        Args:
            signatures: of a pool that holds their commands.
            rows: (n,) of those commands.
            simulated: (n, 5) launches at the release, nominal scene.
            releases: (n,) s.
            effects: that may act.
            camera: (2,) m, point of the plane that the camera looks at.
            starts: (n, 2) m, as seen.
            readings: of the encoders, if there are any.
        """
        # Whose mark on what the camera reports measured launches still bear.
        self._seen = frozenset(name for name, effect in effects.items() if effect.acts_on_camera)
        self._effects, self._camera, self._starts = effects, camera, starts
        self._simulated = simulated
        ahead = releases - signatures.contact[rows] - LOOK
        carry = np.tile(np.eye(5), (len(rows), 1, 1))
        carry[:, 0, 2] = carry[:, 1, 3] = ahead
        self._by_start = np.einsum("nij,njk->nik", carry, signatures.by_start[rows])
        by_joints = np.einsum("nij,njk->nik", carry, signatures.by_joints[rows])
        changes = {
            n: np.einsum("nij,vnj->vni", carry, signatures.launches[n][:, rows]) for n in signatures.values
        }
        self.mean, self.spread = simulated.copy(), np.zeros((len(rows), 5, 5))
        self.encoders: Encoders | None = None
        if readings is not None:
            changes = self._correct(signatures, rows, readings, by_joints, changes)
        self._changes = {n: PchipInterpolator(signatures.values[n], c) for n, c in changes.items()}
        heading = np.arctan2(simulated[:, 3], simulated[:, 2])
        self._turn = np.tile(np.eye(5), (len(rows), 1, 1))
        cosine, sine = np.cos(heading), np.sin(heading)
        for k in (0, 2):
            self._turn[:, k, k] = self._turn[:, k + 1, k + 1] = cosine
            self._turn[:, k, k + 1], self._turn[:, k + 1, k] = -sine, sine
        # What launches do that is smooth in their command is no scatter, but something to be explained.
        smooth = launch_features(simulated)
        self._smooth = np.linalg.qr(smooth)[0] if len(smooth) > 3 * smooth.shape[1] else smooth[:, :0]

    def _correct(
        self,
        signatures: Signatures,
        rows: NDArray[np.int64],
        readings: Readings,
        by_joints: Array,
        changes: dict[str, Array],
    ) -> dict[str, Array]:
        """Take what the encoders say into the mean, and what they say of effects into their changes."""
        ticks = np.clip(
            np.searchsorted(signatures.times, readings.times - 1e-6), 0, len(signatures.times) - 1
        )
        speeds = signatures.swing(rows, readings.times)[1]
        execution = Execution(readings.times, readings.joints - readings.nominal, speeds, readings.replayed)
        contact = signatures.contact[rows]
        at = np.clip(np.searchsorted(readings.times, contact), 0, len(readings.times) - 1)
        offset, rate = pace_matrix(execution, contact, speeds[np.arange(len(rows)), at])
        to_launch = np.einsum("nij,njc->nic", by_joints, np.concatenate([offset, rate], axis=1))
        coefficients, covariance = execution.coefficients(execution.residual)
        self.mean += np.einsum("nic,nc->ni", to_launch, coefficients - readings.replayed)
        self.spread = np.einsum("nic,ncd,njd->nij", to_launch, covariance, to_launch)
        white = {}
        for name, change in changes.items():
            swing = signatures.swings[name][:, rows][:, :, ticks].astype(float)
            white[name] = np.stack([execution.whiten(s) for s in swing])
            # What an effect does to the readings was taken for the execution, and carried to the launch.
            taken = np.stack([execution.coefficients(s)[0] for s in swing])
            changes[name] = change - np.einsum("nic,vnc->vni", to_launch, taken)
        self.encoders = Encoders(
            execution,
            execution.whiten(execution.residual),
            {n: PchipInterpolator(signatures.values[n], w) for n, w in white.items()},
        )
        return changes

    def means(self, effects: Mapping[str, Values]) -> Array:
        """(n, 5) under effects."""
        mean = self.mean.copy()
        for owner, values in effects.items():
            for parameter, value in values.items():
                change = self._changes.get(f"{owner}/{parameter}")
                if change is not None:
                    mean += _at(change, value)
            mean += self._known_shift(owner, values)
            mean += np.einsum("nij,nj->ni", self._by_start, self._start_shift(owner, values))
        return mean

    def given(self, effects: Mapping[str, Values]) -> "LaunchModel":
        """The model under effects whose mark on what the camera reports of a launch is corrected for."""
        other = copy(self)
        other._seen = self._seen - effects.keys()
        other.mean = other.means(effects)
        return other

    def predicted(self, effects: Mapping[str, Values], scatter: Array) -> tuple[Array, Array]:
        """Means (n, 5) under effects, and their covariance (n, 5, 5) for a scatter (5, 5)."""
        return self.means(effects), self._whole(scatter)

    def slopes(self, columns: Sequence[Column], effects: Mapping[str, Values]) -> Array:
        """(n, 5, p) of the means by columns."""
        slopes = np.zeros((*self.mean.shape, len(columns)))
        for c, column in enumerate(columns):
            if column.object >= 0:
                continue
            values = dict(effects.get(column.owner, self._effects[column.owner].neutral()))
            change = self._changes.get(f"{column.owner}/{column.parameter}")
            if change is not None:
                step = column.step
                here = values[column.parameter]
                slopes[..., c] = (_at(change, here + step) - _at(change, here)) / step
            base, known = self._start_shift(column.owner, values), self._known_shift(column.owner, values)
            values[column.parameter] += column.step
            slopes[..., c] += (self._known_shift(column.owner, values) - known) / column.step
            shift = (self._start_shift(column.owner, values) - base) / column.step
            slopes[..., c] += np.einsum("nij,nj->ni", self._by_start, shift)
        return slopes

    def _known_shift(self, owner: str, values: Values) -> Array:
        """(n, 5) change of the launch as it is seen, that needs no simulation."""
        effect = self._effects[owner]
        total = np.zeros_like(self.mean)
        change = effect.shift_launch(values, self._simulated)
        if change is not None:
            total += np.einsum("nij,nj->ni", self._turn, change)
        if owner in self._seen and effect.acts_on_camera:
            total += self._camera_shift(effect, values)
        return total

    def _camera_shift(self, effect: Effect, values: Values) -> Array:
        """(n, 5) seen less true launch: a place, and another a moment later."""
        each = {name: np.full(len(self.mean), value) for name, value in values.items()}
        place, velocity = self._simulated[:, :2], self._simulated[:, 2:4]
        delay = effect.camera_delay(each)
        moment = np.zeros(len(place)) if delay is None else -delay
        speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-6)
        # What slows the object is nearly the same under all hypotheses.
        slowed = velocity * (1 - DECELERATION * moment / speed)[:, None]
        places = (
            np.stack([place, place + SHORT * velocity], axis=1) + moment[:, None, None] * velocity[:, None]
        )
        seen = effect.see(each, places, self._camera)
        shift = np.zeros_like(self.mean)
        shift[:, :2] = seen[:, 0] - place
        shift[:, 2:4] = (seen[:, 1] - seen[:, 0]) / SHORT - velocity + (slowed - velocity)
        return shift

    def _start_shift(self, owner: str, values: Values) -> Array:
        """(n, 2) m by which the object really lay elsewhere, the camera seeing it where it did."""
        effect = self._effects[owner]
        if not effect.acts_on_camera:
            return np.zeros_like(self._starts)
        each = {name: np.full(len(self._starts), value) for name, value in values.items()}
        return self._starts - effect.see(each, self._starts[:, None], self._camera)[:, 0]

    def encoder_rows(
        self, columns: Sequence[Column], effects: Mapping[str, Values]
    ) -> tuple[Array, Array] | None:
        """Whitened residuals (n, rows) and their derivatives (n, rows, p)."""
        if self.encoders is None:
            return None
        left = self.encoders.white.copy()
        for owner, values in effects.items():
            for parameter, value in values.items():
                change = self.encoders.changes.get(f"{owner}/{parameter}")
                if change is not None:
                    left -= _at(change, value)
        slopes = np.zeros((*left.shape, len(columns)), np.float32)
        for c, column in enumerate(columns):
            change = self.encoders.changes.get(f"{column.owner}/{column.parameter}")
            if change is not None:
                here = effects.get(column.owner, self._effects[column.owner].neutral())[column.parameter]
                slopes[..., c] = (_at(change, here + column.step) - _at(change, here)) / column.step
        return left, slopes

    def roots(self, scatter: Array, offset: Array, noise: Array) -> tuple[Array, Array]:
        """Square root information (n, 5, 5) and log determinants (n,) of launches about their means.

        Args:
            scatter: (5, 5) in the frame of the heading.
            offset: (n, 5) launch less mean, by which wild hits are given less weight.
            noise: (n, 5, 5) covariance with which launches were measured.
        """
        covariance = self._whole(scatter) + noise
        information = np.asarray(np.linalg.inv(covariance), float)
        weight = self._weight(offset, information)
        root = np.linalg.cholesky(information).transpose(0, 2, 1) * np.sqrt(weight)[:, None, None]
        return root, np.linalg.slogdet(covariance)[1] - 5 * np.log(weight)

    def scatter(self, offset: Array, noise: Array, before: Array) -> Array:
        """Expectation maximisation: scatter (5, 5) of true launches in the frame of the heading.

        What is smooth in the command is left out: it is to be explained, and no scatter.
        """
        whole = self._whole(before)
        information = np.asarray(np.linalg.inv(whole + noise), float)
        gain = whole @ information
        smooth = np.einsum("nij,nj->ni", self._turn.transpose(0, 2, 1), offset)
        smooth = np.einsum("nij,nj->ni", self._turn, self._smooth @ (self._smooth.T @ smooth))
        rough = offset - smooth
        weight = self._weight(rough, information)
        true = np.einsum("nij,nj->ni", gain, rough)
        local = np.einsum("nji,nj->ni", self._turn, true)
        left = self._turn.transpose(0, 2, 1) @ (whole - gain @ whole - self.spread) @ self._turn
        total = np.einsum("n,ni,nj->ij", weight, local, local) + left.sum(0)
        values, vectors = np.linalg.eigh((total + total.T) / (2 * (len(offset) - self._smooth.shape[1])))
        return (vectors * np.maximum(values, 0)) @ vectors.T + np.diag(LEAST_SD**2)

    def _whole(self, scatter: Array) -> Array:
        """(n, 5, 5) in the world, with what encoders leave open."""
        return self._turn @ scatter @ self._turn.transpose(0, 2, 1) + self.spread

    @staticmethod
    def _weight(offset: Array, information: Array) -> Array:
        """(n,) of a Student's t."""
        distance = np.einsum("ni,nij,nj->n", offset, information, offset)
        return np.minimum((TAILS + 5) / (TAILS + distance), 1.0)


def _at(change: PchipInterpolator, value: float) -> Array:
    """A change at a value; beyond what was simulated, that of the last value."""
    return np.asarray(change(np.clip(value, change.x[0], change.x[-1])), float)
