"""Fit of rest points alone: where commands should have sent objects, against where they came to lie.

What happened on the way is not seen, so that a hit is one point in the plane. It scatters about the point
that its command should give by a share of the distance, along the way and across it; launches and friction
that differ from hit to hit are both in there. Friction of all objects is fitted with every hypothesis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit, GaussNewton
from slapshot.diagnosis.pucks.fit.marginal import Marginal
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel, tail_weight, weight_cost
from slapshot.diagnosis.pucks.selection.free_form import launch_features
from slapshot.diagnosis.pucks.slide.slide_model import STEP_SHARE, Column, Effects, Point, SlideModel, Values
from slapshot.effects.effect import Effect

LEAST_SHARE = 0.005  # of the distance: what rest points scatter by at least
FIRST_SHARE = 0.1
SHORTEST = 0.1  # m: shorter ways scatter like that one
_MISSED = 1e-6  # m: a shorter way is none
WAY = np.linspace(0.0, 1.0, 9)  # places between launch and rest where an effect may reach an object


@dataclass(frozen=True)
class _Rests:
    """Predicted: rests (n, 2) in m, their derivatives (n, 2, p), and frames (n, 2, 2) of the way, in m."""

    places: Array
    slopes: Array
    frames: Array


class RestFitter(GaussNewton):
    """Fits rest points of n hits whose commands are known."""

    iterations = 30

    def __init__(
        self, slides: SlideModel, launches: LaunchModel, effects: Mapping[str, Effect], friction: Array
    ) -> None:
        """Of n hits.

        Args:
            slides: model of tracks whose only frame shows the object at rest.
            launches: that the commands should give.
            effects: that may act.
            friction: (3,) nominal mu_x, mu_y and torsional friction in m.
        """
        super().__init__(effects)
        self._slides = slides
        self._nuisance = np.tile(np.log(friction), (len(slides.tracks.objects), 1))
        self._launches = launches
        self.measured = slides.tracks.places[:, 0]
        smooth = launch_features(self._launches.mean)
        self._smooth = np.linalg.qr(smooth)[0] if len(smooth) > 3 * smooth.shape[1] else smooth[:, :0]
        ends = self._launches.mean[:, None, :2], self.measured[:, None]
        self._way = (ends[0] + WAY[:, None] * (ends[1] - ends[0])).reshape(-1, 2)

    @property
    def first_scatter(self) -> Array:
        """(2, 2) over the distance, along the way and across it."""
        return FIRST_SHARE**2 * np.eye(2)

    def start(self) -> Point:
        """The nominal scene."""
        return Point(np.empty((len(self.measured), 0)), self._nuisance)

    def drop_jumps(self, point: Point) -> None:
        """Rest points have none."""

    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Nuisance of all objects, then parameters of effects that act somewhere on the way."""
        return [
            *self._slides.columns([]),
            *(
                Column(name, p.name, -1, STEP_SHARE * p.scale)
                for name in effects
                for p in self.effects[name].parameters
                if self.effects[name].reaches(p.name, self._way)
            ),
        ]

    def starts(self, name: str) -> Sequence[Values]:
        """None: a screen's estimate is as good as rest points can tell."""
        return ()

    def start_misfit(self, fit: Fit, values: Effects) -> float:
        """No starts need it."""
        return 0.0

    def freedom(self) -> Array:
        """(n,) two coordinates each."""
        return np.full(len(self.measured), 2.0)

    def quadratic(self, fit: Fit, effects: Sequence[str]) -> tuple[list[Column], Marginal, Array]:
        """Columns at a fitted point; hits; (n, 1, 2, p) change of rest points in m."""
        columns = self.columns(effects)
        rests = self._predicted(fit.point, columns)
        return columns, self._marginal(rests, fit.scatter), rests.slopes[:, None]

    def gain_by_tracks(self, fit: Fit, name: str) -> float:
        """None: there are none."""
        return 0.0

    def gain_by_encoders(self, fit: Fit, name: str) -> float:
        """None: where an object comes to rest does not tell how the arm moved."""
        return 0.0

    def _moved_by(self, fit: Fit, name: str) -> Array:
        without = {n: v for n, v in fit.point.effects.items() if n != name}
        moved = self.predict(fit.point) - self.predict(replace(fit.point, effects=without))
        return moved[:, None]

    def predict(self, point: Point) -> Array:
        """(n, 2) m where objects should come to rest."""
        return self._predicted(point, []).places

    def expected(self, point: Point, scatter: Array) -> Array:
        """(n,) m^2: mean square of what rest points scatter by."""
        frames = self._predicted(point, []).frames
        return np.trace(frames @ scatter @ frames.transpose(0, 2, 1), axis1=1, axis2=2)

    def evaluate(self, point: Point, columns: Sequence[Column], scatter: Array) -> Marginal:
        """Hits at a point; they have no unknowns of their own."""
        return self._marginal(self._predicted(point, columns), scatter)

    def _marginal(self, rests: _Rests, scatter: Array) -> Marginal:
        covariance = rests.frames @ scatter @ rests.frames.transpose(0, 2, 1)
        offset = self.measured - rests.places
        weight = _weight(offset, covariance)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance)) * np.sqrt(weight)[:, None, None]
        left = (whiten @ offset[..., None])[..., 0]
        slopes = whiten @ rests.slopes
        none = np.empty((len(offset), 0))
        return Marginal(
            slopes.transpose(0, 2, 1) @ slopes,
            (slopes.transpose(0, 2, 1) @ left[..., None])[..., 0],
            (left**2).sum(1),
            np.linalg.slogdet(covariance)[1] + weight_cost(weight, 2),
            none,
            none[:, :, None],
            none[:, :, None],
        )

    def _scatter(self, point: Point, state: Marginal, before: Array) -> Array:
        """(2, 2) along and across the way; what is smooth in the command is to be explained, no scatter."""
        rests = self._predicted(point, [])
        local = np.linalg.solve(rests.frames, (self.measured - rests.places)[..., None])[..., 0]
        rough = local - self._smooth @ (self._smooth.T @ local)
        weight = _weight(rough, np.broadcast_to(before, (len(rough), 2, 2)))
        total = np.einsum("n,ni,nj->ij", weight, rough, rough)
        return total / (len(rough) - self._smooth.shape[1]) + LEAST_SHARE**2 * np.eye(2)

    def _predicted(self, point: Point, columns: Sequence[Column]) -> _Rests:
        begin = self._launches.means(point)
        latents = np.column_stack([begin, np.zeros(len(begin))])
        at = Point(latents, point.nuisance, point.effects)
        if columns:
            predicted, by_latent, by_column = self._slides.derivatives(at, columns)
            slopes = by_column[:, 0] + by_latent[:, 0, :, :5] @ self._launches.slopes(columns, point)
        else:
            predicted, slopes = self._slides.predict(at), np.zeros((len(begin), 2, 0))
        way = predicted[:, 0] - begin[:, :2]
        # An object that the simulation misses scatters as one that is meant to go where it went.
        missed = np.linalg.norm(way, axis=1) < _MISSED
        way[missed] = (self.measured - begin[:, :2])[missed]
        distance = np.linalg.norm(way, axis=1)
        there = distance[:, None] >= _MISSED
        along = np.where(there, way / np.maximum(distance, _MISSED)[:, None], (1.0, 0.0))
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        frames = np.stack([along, across], axis=-1) * np.maximum(distance, SHORTEST)[:, None, None]
        return _Rests(predicted[:, 0], slopes, frames)


def _weight(offset: Array, covariance: Array) -> Array:
    """(n,) of a Student's t: some hits go wrong."""
    distance = (offset * np.linalg.solve(covariance, offset[..., None])[..., 0]).sum(1)
    return tail_weight(distance, 2)
