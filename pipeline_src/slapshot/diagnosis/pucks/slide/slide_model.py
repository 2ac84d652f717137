"""Where the camera should see every hit's frames, for launches, friction and effects; and its derivatives."""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.slide.tracks import HitTracks
from slapshot.effects.effect import Effect
from slapshot.effects.slide_derivatives import ByParameter, Slides
from slapshot.effects.slide_law import STEP, ActiveEffect, slide

Values = Mapping[str, float]
Effects = Mapping[str, Values]  # effect -> parameter -> value
# Effect -> rows on which it acts, and its values there.
_Values = dict[str, tuple[NDArray[np.int64], dict[str, Array]]]

# Columns of a hit's own unknowns: x, y (m), vx, vy (m/s), spin (rad/s) at release, log friction factor.
LATENTS = ("x", "y", "vx", "vy", "spin", "log_friction")
LATENT_STEPS = np.array([1e-3, 1e-3, 1e-2, 1e-2, 0.5, 1e-2])
# Of each object, shared by its hits: logarithms of mu_x, mu_y and of the torsional friction in m.
NUISANCE = ("log_mu_x", "log_mu_y", "log_mu_torsional")
NUISANCE_STEPS = np.array([1e-2, 1e-2, 5e-2])
# s, of slides that only serve derivatives by what acts on them: those differ by less than a thousandth from
# derivatives at a quarter of this step (tests/diagnosis/pucks/test_slide_model.py).
COARSE_STEP = 2 * STEP
STEP_SHARE = 0.1  # of a parameter's scale, for derivatives
_SMALL = 1e-6  # m, of differences of what the camera reports
ROWS_AT_ONCE = 4000  # hits simulated together, so that arrays stay within the caches


@dataclass(frozen=True)
class Point:
    """Where derivatives are taken.

    Attributes:
        latents: (n, 6) of each hit, see LATENTS.
        nuisance: (objects, 3), see NUISANCE.
        effects: name -> values of the parameters; effects that are left out are absent.
    """

    latents: Array
    nuisance: Array
    effects: Effects = field(default_factory=dict)


@dataclass(frozen=True)
class Column:
    """A parameter that is shared by hits: nuisance `which` of an object, or one of an effect.

    Attributes:
        owner: effect, or object_id for nuisance.
        parameter: name.
        object: index of the object, -1 for an effect.
        step: for derivatives.
    """

    owner: str
    parameter: str
    object: int
    step: float


@dataclass(frozen=True)
class _Bumped:
    """A base hit with one thing changed: rows of a simulation."""

    hits: NDArray[np.int64]
    latents: Array
    log_mu: Array
    changed: tuple[str, str, float] | None = None  # effect, parameter, by how much


class SlideModel:
    """Predicts tracks of given hits of one scene."""

    def __init__(
        self,
        tracks: HitTracks,
        effects: Mapping[str, Effect],
        radius: float,
        camera: Array,
        threads: int = 1,
    ) -> None:
        self.tracks, self.effects, self.radius, self.camera = tracks, effects, radius, camera
        self.threads = threads
        self._duration = float(tracks.times.max()) + 0.05 if len(tracks) else 0.1

    def of(self, tracks: HitTracks) -> "SlideModel":
        """The same scene and other hits."""
        return SlideModel(tracks, self.effects, self.radius, self.camera, self.threads)

    def columns(self, effects: Sequence[str]) -> list[Column]:
        """Nuisance of all objects, then the parameters of the effects."""
        found = [
            Column(name, parameter, k, float(step))
            for k, name in enumerate(self.tracks.objects)
            for parameter, step in zip(NUISANCE, NUISANCE_STEPS, strict=True)
        ]
        places = self.tracks.places[self.tracks.valid]
        for name in effects:
            for p in self.effects[name].parameters:
                if self.effects[name].reaches(p.name, places):
                    found.append(Column(name, p.name, -1, STEP_SHARE * p.scale))
        return found

    def predict(self, point: Point) -> Array:
        """(n, frames, 2) m."""
        return self._seen([self._base(point)], point)[0]

    def derivatives(self, point: Point, columns: Sequence[Column]) -> tuple[Array, Array, Array]:
        """Prediction (n, frames, 2), its derivatives by the latents (n, frames, 2, 6) and by the columns."""
        base = self._base(point)
        bumped = [base]
        for j, step in enumerate(LATENT_STEPS):
            moved = base.latents.copy()
            moved[:, j] += step
            bumped.append(_Bumped(base.hits, moved, base.log_mu))
        acting = [c for c, column in enumerate(columns) if column.object >= 0 or self._acts(column.owner)]
        # Differences between slides depend far less on the time step than the slides do.
        sliding = [
            c for c in acting if columns[c].object < 0 and self.effects[columns[c].owner].acts_on_slide
        ]
        coarse = [c for c in sliding if self.effects[columns[c].owner].moves_mass]
        linear = [c for c in sliding if c not in set(coarse)]
        fine = [c for c in acting if c not in set(sliding)]
        bumped += [self._bumped(base, columns[c]) for c in fine]
        seen = self._seen(bumped, point)
        by_latent = np.stack(
            [(s - seen[0]) / step for s, step in zip(seen[1:7], LATENT_STEPS, strict=True)], axis=-1
        )
        by_column = np.zeros((*seen[0].shape, len(columns)))
        for c, part, s in zip(fine, bumped[7:], seen[7:], strict=True):
            by_column[part.hits, ..., c] = (s - seen[0][part.hits]) / columns[c].step
        if coarse:
            pushed = [base, *(self._bumped(base, columns[c]) for c in coarse)]
            first, *others = self._seen(pushed, point, COARSE_STEP)
            for c, s in zip(coarse, others, strict=True):
                by_column[..., c] = (s - first) / columns[c].step
        if linear:
            by_column[..., linear] = self._by_pushes(base, point, [columns[c] for c in linear])
        return seen[0], by_latent, by_column

    def _by_pushes(self, base: _Bumped, point: Point, columns: Sequence[Column]) -> Array:
        """(n, frames, 2, p) derivatives by parameters of what pushes and rubs."""
        values = self._values([base], np.array([0, len(base.hits)]), point)
        launches, friction = self._launched(base.hits, base.latents, base.log_mu)
        acting = {name: v for name, (_, v) in values.items() if self.effects[name].acts_on_slide}
        slides = Slides(launches, friction, self.radius, self.tracks.order, self.effects, acting)
        by = [ByParameter(self.effects[c.owner], c.parameter, c.step) for c in columns]
        moved = slides.derivatives(by, self._moments(base.hits, values), COARSE_STEP, self.threads)
        if not any(self.effects[name].acts_on_camera for name in values):
            return moved
        places = self._places(base.hits, launches, friction, values, COARSE_STEP)
        seen = self._through_camera(places, values)
        by_place = [(self._through_camera(places + s, values) - seen) / _SMALL for s in _SMALL * np.eye(2)]
        return np.asarray(np.stack(by_place, axis=-1) @ moved)

    def _bumped(self, base: _Bumped, column: Column) -> _Bumped:
        """All hits that a column acts on, with a step of it."""
        if column.object < 0:
            changed = (column.owner, column.parameter, column.step)
            return _Bumped(base.hits, base.latents, base.log_mu, changed)
        hits = np.flatnonzero(self.tracks.object == column.object)
        moved = base.log_mu[hits].copy()
        moved[:, NUISANCE.index(column.parameter)] += column.step
        return _Bumped(hits, base.latents[hits], moved)

    def _acts(self, name: str) -> bool:
        """Whether an effect changes a track, its launch being given."""
        return self.effects[name].acts_on_slide or self.effects[name].acts_on_camera

    def by_latents(self, point: Point) -> tuple[Array, Array]:
        """Prediction and its derivatives by the latents alone."""
        predicted, by_latent, _ = self.derivatives(point, [])
        return predicted, by_latent

    def _base(self, point: Point) -> _Bumped:
        return _Bumped(np.arange(len(self.tracks)), point.latents, point.nuisance[self.tracks.object])

    def _seen(self, parts: Sequence[_Bumped], point: Point, step: float = STEP) -> list[Array]:
        """(hits, frames, 2) of each part, integrated in steps of some seconds."""
        groups: list[list[_Bumped]] = [[]]
        for part in parts:
            if groups[-1] and sum(len(p.hits) for p in groups[-1]) + len(part.hits) > ROWS_AT_ONCE:
                groups.append([])
            groups[-1].append(part)
        # NumPy lets go of the interpreter in its loops over thousands of rows.
        with ThreadPoolExecutor(self.threads) as pool:
            simulated = pool.map(lambda group: self._simulate(group, point, step), groups)
            return [places for group in simulated for places in group]

    def _simulate(self, parts: Sequence[_Bumped], point: Point, step: float) -> list[Array]:
        hits = np.concatenate([p.hits for p in parts])
        latents = np.concatenate([p.latents for p in parts])
        log_mu = np.concatenate([p.log_mu for p in parts])
        bounds = np.cumsum([0, *(len(p.hits) for p in parts)])
        values = self._values(parts, bounds, point)
        launches, friction = self._launched(hits, latents, log_mu)
        places = self._through_camera(self._places(hits, launches, friction, values, step), values)
        return [places[a:b] for a, b in pairwise(bounds)]

    def _launched(self, hits: NDArray[np.int64], latents: Array, log_mu: Array) -> tuple[Array, Array]:
        """Launches (rows, 6) and friction (rows, 3)."""
        friction = np.exp(log_mu)
        friction[:, :2] *= np.exp(latents[:, 5:6])
        return np.column_stack([latents[:, :2], self.tracks.turned[hits], latents[:, 2:5]]), friction

    def _moments(self, hits: NDArray[np.int64], values: _Values) -> Array:
        """(rows, frames) s since the launch at which the camera saw what it reports."""
        times = self.tracks.times[hits]
        for name, (rows, v) in values.items():
            delay = self.effects[name].camera_delay(v)
            if delay is not None:
                times = times.copy()
                times[rows] -= delay[:, None]
        return times

    def _places(
        self,
        hits: NDArray[np.int64],
        launches: Array,
        friction: Array,
        values: _Values,
        step: float,
    ) -> Array:
        """(rows, frames, 2) m where objects are."""
        slides = [
            ActiveEffect(self.effects[name], rows, v)
            for name, (rows, v) in values.items()
            if self.effects[name].acts_on_slide
        ]
        # Nobody looks at what moves on after the last frame.
        until = {"duration": self._duration, "longest": self._duration}
        order = self.tracks.order[hits]
        tracks = slide(launches, friction, self.radius, acting=slides, order=order, step=step, **until)
        times = self._moments(hits, values)
        places = tracks.at(times)
        back = np.minimum(times, 0.0)[..., None]
        if (back < 0).any():
            # A late camera shows what was before the release; the object was faster then.
            first = tracks.places[:, :3]
            slowing = (first[:, 2] - 2 * first[:, 1] + first[:, 0]) / (tracks.times[1] - tracks.times[0]) ** 2
            places = places + back * launches[:, None, 3:5] + back**2 / 2 * slowing[:, None]
        return places

    def _through_camera(self, places: Array, values: _Values) -> Array:
        """The same as the camera reports them."""
        places = places.copy()
        for name, (rows, v) in values.items():
            if self.effects[name].acts_on_camera:
                places[rows] = self.effects[name].see(v, places[rows], self.camera)
        return places

    def _values(self, parts: Sequence[_Bumped], bounds: NDArray[np.int64], point: Point) -> _Values:
        """Effect -> rows on which it acts, and its values there: one where they are the same for all rows."""
        found: _Values = {}
        everywhere = np.arange(bounds[-1])
        for name, base in point.effects.items():
            if not self._acts(name):
                continue
            found[name] = (everywhere, _constant(base))
        rows_of: dict[str, list[NDArray[np.int64]]] = {}
        bumps: list[tuple[str, str, float, NDArray[np.int64]]] = []
        for part, begin, end in zip(parts, bounds[:-1], bounds[1:], strict=True):
            if part.changed is not None:
                name, parameter, by = part.changed
                rows = np.arange(begin, end)
                rows_of.setdefault(name, []).append(rows)
                bumps.append((name, parameter, by, rows))
        for name, bumped in rows_of.items():
            if name not in found:
                found[name] = (np.concatenate(bumped), _constant(self.effects[name].neutral()))
        for name, (mine, same) in found.items():
            if name in rows_of or self.effects[name].acts_on_camera:
                found[name] = (mine, {p: np.full(len(mine), v) for p, v in same.items()})
        for name, parameter, by, rows in bumps:
            mine, values = found[name]
            values[parameter][np.searchsorted(mine, rows)] += by
        return found


def _constant(values: Values) -> dict[str, Array]:
    """One value of each parameter for all hits."""
    return {name: np.asarray(value) for name, value in values.items()}
