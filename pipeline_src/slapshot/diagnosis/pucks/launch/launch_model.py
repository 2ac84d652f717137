"""Where and how fast every object should be at its release, given its command, encoders, and effects.

The launch (x, y, vx, vy, spin) of hit i has a Gaussian prior: the simulated launch of its command with the
object where the camera saw it lie, corrected by how the encoders say the arm moved, and by effects, with a
scatter that hits share, in the frame of their heading. Encoders add evidence of their own on effects that
they see.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.launch.encoders import Encoders, each, value_at
from slapshot.diagnosis.pucks.launch.execution import Execution, Readings, pace_matrix
from slapshot.diagnosis.pucks.launch.launch_prior import LAUNCH, SPIN
from slapshot.diagnosis.pucks.launch.on_the_way import OnTheWay
from slapshot.diagnosis.pucks.launch.signatures import LOOK, Signatures
from slapshot.diagnosis.pucks.launch.swing_error import LATENESS, LONGEST, launches_late, swings_late
from slapshot.diagnosis.pucks.selection.free_form import FreeLaunchForm, NominalLaunches, launch_features
from slapshot.diagnosis.pucks.slide.camera_view import start_shift
from slapshot.diagnosis.pucks.slide.slide_model import NUISANCE, NUISANCE_STEPS, Column, Point, Values
from slapshot.effects.effect import Effect

LEAST_SD = np.array([5e-4, 5e-4, 5e-3, 5e-3, 0.1])  # m, m/s, rad/s: contact is no better known than that
EXPECTATIONS = 10  # steps of expectation maximisation within one of Gauss and Newton
CONTACT = 0.01  # s for which a striker pushes
TAILS = 6.0  # degrees of freedom of a launch: some hits go wrong
SIMULATED_SPIN_SD = 0.6  # rad/s: three times by which a simulation of the hit errs
LATE = np.array([-LONGEST, 0.0, LONGEST])  # s: what a joint's lateness does is linear
FIRST_SD = np.array([0.02, 0.02, 0.15, 0.15, SIMULATED_SPIN_SD])


@dataclass(frozen=True)
class LocalChange:
    """How n launches change from one value of a parameter to another nearby.

    Attributes:
        here, there: the values.
        change: (n, 5).
    """

    here: float
    there: float
    change: Array

    def take(self, rows: NDArray[np.int64]) -> "LocalChange":
        """Of some of the launches."""
        return replace(self, change=self.change[rows])

    def about(self, value: float) -> "LocalChange":
        """The same change about another value."""
        return replace(self, here=value, there=self.there - self.here + value)

    def line_through(self, level: Array) -> PchipInterpolator:
        """Of parameter -> change (n, 5), which is `level` (n, 5) here."""
        values, changes = [self.here, self.there], [level, level + self.change]
        ascending = np.argsort(values)
        return PchipInterpolator(np.array(values)[ascending], np.stack(changes)[ascending])


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
        approach: Array,
        base: Mapping[str, Values] | None = None,
        reference: Execution | None = None,
        turned: Array | None = None,
        local: Mapping[str, LocalChange] | None = None,
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
            approach: (n, 2) as in NominalLaunches.
            base: effects with which hits were simulated; None for the nominal scene.
            reference: execution whose scatter is taken for known; None to estimate it.
            turned: (n,) rad by which objects had turned at the release; None for not at all.
            local: effect/parameter -> how it goes on changing about `base`, instead of as in the signatures.
        """
        self._effects, self._camera, self._starts = effects, camera, starts
        self._starts_seen = starts_seen[:, None]
        self.turned = np.zeros(len(rows)) if turned is None else turned
        self._simulated, self._object, self._friction = simulated, objects, friction
        ahead = releases - signatures.contact[rows] - LOOK
        struck = np.where(np.isnan(contact), releases, contact)
        free = np.maximum(releases - struck - CONTACT, 0.0)
        self._way = OnTheWay(simulated, free, order, friction)
        carry = np.tile(np.eye(5), (len(rows), 1, 1))
        carry[:, 0, 2] = carry[:, 1, 3] = ahead
        self._by_start = np.einsum("nij,njk->nik", carry, signatures.by_start[rows])
        by_joints = np.einsum("nij,njk->nik", carry, signatures.by_joints[rows])
        self._nominal = NominalLaunches(simulated, by_joints, approach)
        self._bases: dict[str, Array] = {}
        changes = {
            n: np.einsum("nij,vnj->vni", carry, signatures.launches[n][:, rows]) for n in signatures.values
        }
        sizes = dict(signatures.values)
        if LATENESS in effects:
            _, speeds, accelerations = signatures.swing_at(rows, signatures.contact[rows])
            late = launches_late(LATE, by_joints, speeds, accelerations)
            names = [f"{LATENESS}/{p.name}" for p in effects[LATENESS].parameters][: len(late)]
            sizes |= dict.fromkeys(names, LATE)
            changes |= dict(zip(names, late, strict=True))
        self.mean, self.spread = simulated.copy(), np.zeros((len(rows), 5, 5))
        self.encoders: Encoders | None = None
        if readings is not None:
            changes = self._correct(signatures, rows, readings, by_joints, changes, sizes, reference)
        self._changes = {n: PchipInterpolator(sizes[n], c) for n, c in changes.items()}
        # As large here as the signatures have it, so that a point without the effect has the nominal launch.
        for name, change in (local or {}).items():
            self._changes[name] = change.line_through(value_at(self._changes[name], change.here))
        # Hits were simulated with the objects where they really lay.
        for name, values in (base or {}).items():
            self.mean -= np.einsum("nij,nj->ni", self._by_start, self._start_shift(name, values))
        for name, value in each(base or {}):
            if name in self._changes:
                self.mean -= value_at(self._changes[name], value)
            if self.encoders is not None and name in self.encoders.changes:
                self.encoders.white[...] += value_at(self.encoders.changes[name], value)
        self._turn = self._nominal.turn
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
        sizes: Mapping[str, Array],
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
        late = iter(swings_late(LATE, speeds))
        for name, change in changes.items():
            known = signatures.swings.get(name)
            swing = next(late) if known is None else known[:, rows][:, :, ticks].astype(float)
            white[name] = np.stack([execution.whiten(s) for s in swing])
            # What an effect does to the readings was taken for the execution, and carried to the launch.
            taken = np.stack([execution.coefficients(s)[0] for s in swing])
            changes[name] = change - np.einsum("nic,vnc->vni", to_launch, taken)
        self.encoders = Encoders(
            execution,
            execution.whiten(execution.residual),
            {n: PchipInterpolator(sizes[n], w) for n, w in white.items()},
        )
        return changes

    def without_encoders(self) -> "LaunchModel":
        """The same launches, of hits whose swing nobody read."""
        other = copy(self)
        other.encoders = None
        return other

    def sizes(self, name: str) -> list[Values]:
        """Values at which an effect was simulated, one parameter at a time, but for the neutral ones.

        Parameters none of which can be negative, as of several joints, are also taken all at once.
        """
        parameters, neutral = self._effects[name].parameters, self._effects[name].neutral()
        simulated = {
            p.name: [float(x) for x in self._changes[f"{name}/{p.name}"].x if x != p.neutral]
            for p in parameters
            if f"{name}/{p.name}" in self._changes
        }
        alone: list[Values] = [{**neutral, p: value} for p, values in simulated.items() for value in values]
        if len(simulated) < 2 or any(p.low != p.neutral for p in parameters):
            return alone
        together = zip(*simulated.values(), strict=False)
        return alone + [{**neutral, **dict(zip(simulated, values, strict=True))} for values in together]

    @property
    def first_scatter(self) -> Array:
        """(5, 5) before it is estimated."""
        return np.diag(FIRST_SD**2)

    flat = 0

    @property
    def rows(self) -> int:
        """Of the encoders' readings; a launch is told by its prior as well as it is fitted."""
        return 0 if self.encoders is None else self.encoders.readings

    def offsets(self, point: Point) -> Array:
        """(n, 5) means less launches at a point."""
        return self.means(point) - point.latents[:, :LAUNCH]

    def simulated_spin(self, point: Point) -> tuple[Array, float]:
        """(n,) rad/s, and its sd."""
        return self.means(point)[:, SPIN], SIMULATED_SPIN_SD

    def misfit(self, point: Point, measured: Array, noise: Array, scatter: Array) -> float:
        """-2 log likelihood of launches (n, 5) that were measured with covariance (n, 5, 5)."""
        whole = self._whole(scatter) + noise
        offset = measured - self.means(point)
        information = np.asarray(np.linalg.inv(whole), float)
        distance = np.einsum("ni,nij,nj->n", offset, information, offset)
        weight = tail_weight(distance, LAUNCH)
        total = float((weight * distance + weight_cost(weight, LAUNCH)).sum())
        read = self.encoder_rows([], point)
        return total if read is None else total + float((read[0] ** 2).sum())

    def means(self, point: Point) -> Array:
        """(n, 5) under the effects and the friction of a point."""
        mean = self.mean.copy()
        for name, value in each(point.effects):
            if name in self._changes:
                mean += value_at(self._changes[name], value)
        for owner, values in point.effects.items():
            mean += self._known_shift(owner, values)
            mean += np.einsum("nij,nj->ni", self._by_start, self._start_shift(owner, values))
        return mean + self._on_the_way(point)

    def _on_the_way(self, point: Point) -> Array:
        """(n, 5) by which the slide changes a launch between striker and release."""
        # What changes the scene's model was simulated on the way as well.
        sliding = [
            (self._effects[n], v)
            for n, v in point.effects.items()
            if self._effects[n].acts_on_slide and not self._effects[n].acts_on_launch
        ]
        by_friction = self._by_friction * (point.nuisance[self._object] - np.log(self._friction))[:, None]
        shift = by_friction.sum(-1)
        return shift + self._way.shift(sliding, self._friction) if sliding else shift

    @cached_property
    def _by_friction(self) -> Array:
        """(n, 5, 3) of the means by the logarithms of friction: the way is short."""
        steps = NUISANCE_STEPS * np.eye(len(NUISANCE_STEPS))
        shifts = [self._way.shift([], self._friction * np.exp(step)) for step in steps]
        return np.stack(shifts, axis=-1) / NUISANCE_STEPS

    def predicted(self, point: Point, scatter: Array) -> tuple[Array, Array]:
        """Means (n, 5) at a point, and their covariance (n, 5, 5) for a scatter (5, 5)."""
        return self.means(point), self._whole(scatter)

    def slopes(self, columns: Sequence[Column], point: Point) -> Array:
        """(n, 5, p) of the means by columns."""
        slopes = np.zeros((*self.mean.shape, len(columns)))
        on_the_way = self._on_the_way(point)
        linear = self._linear_on_the_way(columns)
        for c, column in enumerate(columns):
            if c in linear:
                slopes[..., c] = linear[c]
                continue
            if column.object >= 0:
                mine = self._object == column.object
                slopes[mine, :, c] = self._by_friction[mine, :, NUISANCE.index(column.parameter)]
                continue
            effect = self._effects[column.owner]
            values = dict(point.effects.get(column.owner) or effect.neutral())
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
            if effect.acts_on_slide and not effect.acts_on_launch:
                moved = self._on_the_way(replace(point, effects={**point.effects, column.owner: values}))
                slopes[..., c] += (moved - on_the_way) / column.step
        return slopes

    def _linear_on_the_way(self, columns: Sequence[Column]) -> dict[int, Array]:
        """Column -> (n, 5) of the means, of those that act on the way alone and linearly."""
        found: dict[int, Array] = {}
        for owner in dict.fromkeys(column.owner for column in columns if column.object < 0):
            effect = self._effects[owner]
            if effect.acts_on_slide and not effect.acts_on_launch:
                mine = [c for c, column in enumerate(columns) if column.owner == owner]
                shapes = self._way.by_shapes(effect, [columns[c].parameter for c in mine])
                if shapes is not None:
                    found.update(zip(mine, np.moveaxis(shapes, -1, 0), strict=True))
        return found

    def _known_shift(self, owner: str, values: Values) -> Array:
        """(n, 5) change of the launch that needs no simulation: of free forms."""
        effect = self._effects[owner]
        if not isinstance(effect, FreeLaunchForm):
            return np.zeros_like(self.mean)
        if owner not in self._bases:
            self._bases[owner] = effect.basis(self._nominal)
        return self._bases[owner] @ np.array([values[p.name] for p in effect.parameters])

    def _start_shift(self, owner: str, values: Values) -> Array:
        shift = start_shift(self._effects[owner], values, self._starts, self._camera)
        return np.where(self._starts_seen, shift, 0.0)

    @property
    def execution(self) -> Execution | None:
        """How hits were executed; None without encoders."""
        return None if self.encoders is None else self.encoders.execution

    def encoder_rows(self, columns: Sequence[Column], point: Point) -> tuple[Array, Array] | None:
        """Whitened residuals (n, rows) and their derivatives (n, rows, p); None without encoders."""
        if self.encoders is None:
            return None
        neutral = {
            column.owner: self._effects[column.owner].neutral() for column in columns if column.object < 0
        }
        return self.encoders.rows(columns, point.effects, neutral)

    def roots(self, scatter: Array, measured: Array, noise: Array) -> tuple[Array, Array]:
        """Square root information (n, 5, 5) of launches, and log determinants (n,) of their covariance.

        Args:
            scatter: (5, 5) in the frame of the heading.
            measured: (n, 5) means less launches as slides tell them, by which wild hits weigh less.
            noise: (n, 5, 5) covariance with which slides tell them.
        """
        covariance = self._whole(scatter)
        weight = self._weight(measured, np.asarray(np.linalg.inv(covariance + noise), float))
        information = np.asarray(np.linalg.inv(covariance), float)
        root = np.linalg.cholesky(information).transpose(0, 2, 1) * np.sqrt(weight)[:, None, None]
        return root, np.linalg.slogdet(covariance)[1] + weight_cost(weight, LAUNCH)

    def scatter(self, point: Point, measured: Array, noise: Array, before: Array) -> Array:
        """Expectation maximisation: scatter (5, 5) of true launches in the frame of the heading.

        What is smooth in the command is left out: it is to be explained, and no scatter.

        Args:
            point: of the means.
            measured: (n, 5) launches as slides alone tell them.
            noise: (n, 5, 5) covariance of those.
            before: (5, 5) of the step before.
        """
        offset = np.einsum("nji,nj->ni", self._turn, measured - self.means(point))
        # A launch that its slide hardly tells would throw that of all others off, and the fit to and fro.
        known = np.diag(before)
        untold = np.einsum("nji,njk,nki->ni", self._turn, noise, self._turn)
        smooth = weighted_projection(self._smooth, offset, known / (known + untold))
        rough = np.einsum("nij,nj->ni", self._turn, offset - smooth)
        scatter = before
        for _ in range(EXPECTATIONS):
            whole = self._whole(scatter)
            information = np.asarray(np.linalg.inv(whole + noise), float)
            gain = whole @ information
            weight = self._weight(rough, information)
            local = np.einsum("nji,njk,nk->ni", self._turn, gain, rough)
            left = self._turn.transpose(0, 2, 1) @ (whole - gain @ whole - self.spread) @ self._turn
            total = np.einsum("n,ni,nj->ij", weight, local, local) + left.sum(0)
            values, vectors = np.linalg.eigh((total + total.T) / (2 * (len(rough) - self._smooth.shape[1])))
            scatter = (vectors * np.maximum(values, 0)) @ vectors.T + np.diag(LEAST_SD**2)
            # Places hardly tell how fast a round object spins: of that the scatter is what is believed.
            scatter[SPIN], scatter[:, SPIN] = 0.0, 0.0
            scatter[SPIN, SPIN] = SIMULATED_SPIN_SD**2
        return scatter

    def _whole(self, scatter: Array) -> Array:
        """(n, 5, 5) in the world, with what encoders leave open."""
        return self._turn @ scatter @ self._turn.transpose(0, 2, 1) + self.spread

    @staticmethod
    def _weight(offset: Array, information: Array) -> Array:
        """(n,) of a Student's t."""
        return tail_weight(np.einsum("ni,nij,nj->n", offset, information, offset), LAUNCH)


def tail_weight(distance: Array, size: int) -> Array:
    """(n,) weights of squared distances of so many coordinates: of a Student's t, but at most 1."""
    return np.minimum((TAILS + size) / (TAILS + distance), 1.0)


def weight_cost(weight: Array, size: int) -> Array:
    """(n,) what weights add to weighted squared distances, so that the sum is least at `tail_weight`.

    There it grows with the distance as -2 log density does: by itself up to `size`, then by its logarithm.
    """
    return TAILS * (weight - 1 - np.log(weight)) - size * np.log(weight)


def weighted_projection(basis: Array, values: Array, weights: Array) -> Array:
    """(n, k) values (n, k) as combinations of a basis (n, b), by least squares weighted by (n, k)."""
    product = np.einsum("nb,nk,nc->kbc", basis, weights, basis)
    fitted = np.linalg.solve(product, np.einsum("nb,nk,nk->kb", basis, weights, values)[..., None])[..., 0]
    return np.asarray(basis @ fitted.T)
