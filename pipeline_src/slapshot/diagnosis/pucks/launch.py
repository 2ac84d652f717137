"""Where and how fast every object should be at its release, given its command, encoders, and effects.

The launch (x, y, vx, vy, spin) of hit i has a Gaussian prior: the simulated launch of its command with the
object where the camera saw it lie, corrected by how the encoders say the arm moved, and by effects, with a
scatter that hits share, in the frame of their heading. Encoders add evidence of their own on effects that
they see.
"""

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.camera_view import camera_shift, start_shift
from slapshot.diagnosis.pucks.encoders import Encoders, each, value_at
from slapshot.diagnosis.pucks.execution import Execution, Readings, pace_matrix
from slapshot.diagnosis.pucks.free_form import launch_features
from slapshot.diagnosis.pucks.on_the_way import shift_on_the_way
from slapshot.diagnosis.pucks.signatures import LOOK, Signatures
from slapshot.diagnosis.pucks.slide_model import Column, Values
from slapshot.effects.effect import Effect

LEAST_SD = np.array([5e-4, 5e-4, 5e-3, 5e-3, 0.1])  # m, m/s, rad/s: contact is no better known than that
FIRST_SD = np.array([0.02, 0.02, 0.15, 0.15, 2.0])
CONTACT = 0.01  # s for which a striker pushes
TAILS = 6.0  # degrees of freedom of a launch: some hits go wrong


class LaunchModel:
    """Prior of the launches of n hits."""

    def __init__(
        self,
        signatures: Signatures,
        rows: NDArray[np.int64],
        simulated: Array,
        contact: Array,
        releases: Array,
        effects: Mapping[str, Effect],
        camera: Array,
        starts: Array,
        starts_seen: NDArray[np.bool_],
        order: Array,
        objects: NDArray[np.int64],
        friction: Array,
        readings: Readings | None,
        base: Mapping[str, Values] | None = None,
        reference: Execution | None = None,
    ) -> None:
        """Of n hits.

        Args:
            signatures: of a pool that holds their commands.
            rows: (n,) of those commands.
            simulated: (n, 5) launches at the release, nominal scene.
            contact: (n,) s at which objects were struck.
            releases: (n,) s.
            effects: that may act.
            camera: (2,) m, point of the plane that the camera looks at.
            starts: (n, 2) m, where objects lay.
            starts_seen: (n,) whether it was the camera that said so.
            order: (n,) place in the recording, -1/2 to 1/2.
            objects: (n,) index of the object.
            friction: (n, 3) mu_x, mu_y, torsional in m, with which hits were simulated.
            readings: of the encoders, if there are any.
            base: effects with which hits were simulated; None for the nominal scene.
            reference: execution whose scatter is taken for known; None to estimate it.
        """
        # Whose mark on what the camera reports measured launches still bear.
        self._seen = frozenset(name for name, effect in effects.items() if effect.acts_on_camera)
        self._effects, self._camera, self._starts = effects, camera, starts
        self._starts_seen = starts_seen[:, None]
        self._simulated, self._object, self._friction = simulated, objects, friction
        ahead = releases - signatures.contact[rows] - LOOK
        struck = np.where(np.isnan(contact), releases, contact)
        self._free, self._order = np.maximum(releases - struck - CONTACT, 0.0), order
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
            changes = self._correct(signatures, rows, readings, by_joints, changes, reference)
        self._changes = {n: PchipInterpolator(signatures.values[n], c) for n, c in changes.items()}
        for name, values in (base or {}).items():
            self.mean -= np.einsum("nij,nj->ni", self._by_start, self._start_shift(name, values))
        for name, value in each(base or {}):
            if name in self._changes:
                self.mean -= value_at(self._changes[name], value)
            if self.encoders is not None and name in self.encoders.changes:
                self.encoders.white[...] += value_at(self.encoders.changes[name], value)
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
        reference: Execution | None,
    ) -> dict[str, Array]:
        """Take what the encoders say into the mean, and what they say of effects into their changes."""
        ticks = np.clip(
            np.searchsorted(signatures.times, readings.times - 1e-6), 0, len(signatures.times) - 1
        )
        speeds = signatures.swing(rows, readings.times)[1]
        left = readings.joints - readings.nominal
        execution = Execution(readings.times, left, speeds, readings.replayed, reference)
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

    def sizes(self, name: str) -> list[Values]:
        """Values at which an effect was simulated, but for the neutral ones."""
        neutral = self._effects[name].neutral()
        return [
            {**neutral, parameter: float(value)}
            for parameter in neutral
            if f"{name}/{parameter}" in self._changes
            for value in self._changes[f"{name}/{parameter}"].x
            if value != neutral[parameter]
        ]

    def means(self, effects: Mapping[str, Values]) -> Array:
        """(n, 5) under effects."""
        mean = self.mean.copy()
        for name, value in each(effects):
            if name in self._changes:
                mean += value_at(self._changes[name], value)
        for owner, values in effects.items():
            mean += self._known_shift(owner, values)
            mean += np.einsum("nij,nj->ni", self._by_start, self._start_shift(owner, values))
        return mean

    def given(self, effects: Mapping[str, Values], log_friction: Array) -> "LaunchModel":
        """The model under what slides were found to lack.

        Args:
            effects: whose mark on what the camera reports of a launch is corrected for.
            log_friction: (objects, 3) of mu_x, mu_y and torsional friction in m.
        """
        other = copy(self)
        other._seen = self._seen - effects.keys()
        other.mean = other.means(effects) + self._on_the_way(effects, np.exp(log_friction)[self._object])
        return other

    def _on_the_way(self, effects: Mapping[str, Values], friction: Array) -> Array:
        """(n, 5) by which the slide changes a launch between striker and release."""
        sliding = [(self._effects[n], v) for n, v in effects.items() if self._effects[n].acts_on_slide]
        both = self._friction, friction
        return shift_on_the_way(sliding, self._simulated, self._free, self._order, both)

    def predicted(self, effects: Mapping[str, Values], scatter: Array) -> tuple[Array, Array]:
        """Means (n, 5) under effects, and their covariance (n, 5, 5) for a scatter (5, 5)."""
        return self.means(effects), self._whole(scatter)

    def slopes(self, columns: Sequence[Column], effects: Mapping[str, Values]) -> Array:
        """(n, 5, p) of the means by columns."""
        slopes = np.zeros((*self.mean.shape, len(columns)))
        for c, column in enumerate(columns):
            # Neither friction nor a description of the slide alone changes how objects are launched.
            if column.object >= 0 or column.owner not in self._effects:
                continue
            values = dict(effects.get(column.owner) or self._effects[column.owner].neutral())
            change = self._changes.get(f"{column.owner}/{column.parameter}")
            if change is not None:
                step = column.step
                here = values[column.parameter]
                slopes[..., c] = (value_at(change, here + step) - value_at(change, here)) / step
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
            total += camera_shift(effect, values, self._simulated, self._camera)
        return total

    def _start_shift(self, owner: str, values: Values) -> Array:
        shift = start_shift(self._effects[owner], values, self._starts, self._camera)
        return np.where(self._starts_seen, shift, 0.0)

    @property
    def execution(self) -> Execution | None:
        """How hits were executed; None without encoders."""
        return None if self.encoders is None else self.encoders.execution

    def encoder_rows(
        self, columns: Sequence[Column], effects: Mapping[str, Values]
    ) -> tuple[Array, Array] | None:
        """Whitened residuals (n, rows) and their derivatives (n, rows, p); None without encoders."""
        if self.encoders is None:
            return None
        neutral = {column.owner: self._effects[column.owner].neutral() for column in columns}
        return self.encoders.rows(columns, effects, neutral)

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
