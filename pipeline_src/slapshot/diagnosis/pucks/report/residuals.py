"""Pushes that a fitted scene lacks, in m/s^2: over the board, and against one variable.

About a fit the tracks are linear in the weights w of a force sum_j w_j phi_j. With each hit's launch
integrated out (see `marginal`) and the fitted friction held, score s and information B give

    w ~ N(C s, C),  C = (B + P)^-1,

P the information of the weights' prior. What another friction would explain has been taken out by the fit.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.selection.evidence import LARGEST
from slapshot.diagnosis.pucks.selection.free_form import FreePlaceForce
from slapshot.diagnosis.pucks.selection.search import Candidate
from slapshot.effects.bases import COARSE_BOARD
from slapshot.effects.effect import Effect, Follows, Parameter, SlideState

BINS = 8
MOVING = 0.05  # m/s: slower frames have no heading
CELL = 0.15  # m
FEWEST = 3  # hits in a cell that is judged
STEP_SD = 0.1  # m/s^2 by which neighbouring bins differ: single ones could not be told apart
SIDES = ("along", "left")  # of the motion
CHANCE = 0.1  # that anything is called significant where nothing is
Z90 = 1.645
_SCALE = 0.1  # m/s^2, of the prior


@dataclass(frozen=True)
class Linear:
    """Weights of a force: parameter -> row, their mean (p,) and covariance (p, p) in m/s^2."""

    rows: Mapping[str, int]
    mean: Array
    covariance: Array

    def at(self, shapes: Mapping[str, Array]) -> tuple[Array, Array]:
        """Value and standard deviation (n,) of sum_j w_j phi_j; `shapes` maps parameter -> phi_j (n,).

        A parameter that no hit comes near has no weight and counts as 0.
        """
        chosen = [name for name in shapes if name in self.rows]
        phi = np.stack([shapes[name] for name in chosen], axis=1)
        rows = [self.rows[name] for name in chosen]
        spread = np.einsum("ni,ij,nj->n", phi, self.covariance[np.ix_(rows, rows)], phi)
        return phi @ self.mean[rows], np.sqrt(spread)


def linear_estimate(
    fitter: HitFitter, at: Candidate, form: Effect, steps: Sequence[tuple[str, str]] = ()
) -> Linear:
    """The force of `form` that is left at a fit; `steps` are pairs of weights that are much alike."""
    own = fitter.slides_alone(at.fit.point)
    own.model = copy(fitter.model)
    own.effects = own.model.effects = {**fitter.model.effects, form.name: form}
    columns, marginal, _ = own.quadratic(at.fit, [*at.effects, form.name])
    mine = np.array([c for c, column in enumerate(columns) if column.owner == form.name], np.int64)
    # Where the fit leaves more than noise, all that is told from it is less certain.
    inflation = max(1.0, at.fit.dispersion)
    information = marginal.information.sum(0)[np.ix_(mine, mine)] / inflation
    rows = {columns[c].parameter: k for k, c in enumerate(mine)}
    scales = {p.name: p.scale for p in form.parameters}
    prior = np.diag([(LARGEST * scales[name]) ** -2 for name in rows])
    for a, b in steps:
        difference = np.zeros(len(mine))
        difference[[rows[a], rows[b]]] = -1.0, 1.0
        prior += np.outer(difference, difference) / STEP_SD**2
    covariance = np.linalg.inv(information + prior)
    return Linear(rows, covariance @ marginal.scores[:, mine].sum(0) / inflation, covariance)


def force_at(fitter: HitFitter, at: Candidate, places: Array) -> tuple[Array, Array]:
    """Push along world x and y at `places` (n, 2) m: value (n, 2) and covariance (n, 2, 2), m/s^2."""
    found = linear_estimate(fitter, at, FreePlaceForce())
    bumps = bump_shapes(places)
    phi = np.zeros((len(places), 2, len(found.mean)))
    for axis, prefix in enumerate(("ax", "ay")):
        for j, bump in enumerate(bumps):
            if f"{prefix}_{j}" in found.rows:
                phi[:, axis, found.rows[f"{prefix}_{j}"]] = bump
    return phi @ found.mean, np.einsum("nap,pq,nbq->nab", phi, found.covariance, phi)


def arrow_table(fitter: HitFitter, at: Candidate) -> pd.DataFrame:
    """A row a cell of the board: x_m, y_m, hits, ax and ay in m/s^2 with 90 % bounds, significant."""
    places, hits = cells(fitter)
    push, covariance = force_at(fitter, at, places)
    squared = np.einsum("na,nab,nb->n", push, np.linalg.inv(covariance), push)
    table = {"x_m": places[:, 0], "y_m": places[:, 1], "hits": hits}
    for axis, name in enumerate(("ax", "ay")):
        half = Z90 * np.sqrt(covariance[:, axis, axis])
        table |= {f"{name}_m_s2": push[:, axis], f"{name}_low": push[:, axis] - half}
        table |= {f"{name}_high": push[:, axis] + half}
    # Chi-squared of two degrees of freedom exceeds c with probability exp(-c / 2); by Bonferroni.
    limit = -2 * np.log(CHANCE / max(len(places), 1))
    return pd.DataFrame(table | {"significant": squared > limit})


def along_at(fitter: HitFitter, at: Candidate, places: Array) -> tuple[Array, Array]:
    """Push along the motion at `places` (n, 2) m: value and standard deviation (n,), m/s^2."""
    found = linear_estimate(fitter, at, _PlaceAlong())
    return found.at({f"along_{j}": bump for j, bump in enumerate(bump_shapes(places))})


def bump_shapes(places: Array) -> Array:
    """(bumps, n) of the board's bumps at places (n, 2) in m."""
    return COARSE_BOARD.shapes(range(len(COARSE_BOARD)), *places.T)


def cells(fitter: HitFitter) -> tuple[Array, NDArray[np.int64]]:
    """Middles (n, 2) in m of squares that at least FEWEST hits passed, and how many did (n,)."""
    tracks = fitter.model.tracks
    hits = np.repeat(np.arange(len(tracks)), fitter.valid.sum(1))
    squares = np.round(tracks.places[fitter.valid] / CELL).astype(np.int64)
    visited = np.unique(np.column_stack([squares, hits]), axis=0)
    found, count = np.unique(visited[:, :2], axis=0, return_counts=True)
    enough = count >= FEWEST
    return found[enough] * CELL, count[enough].astype(np.int64)


def variable_of(fitter: HitFitter, at: Candidate, variable: Follows) -> Array:
    """(m,) the variable in every frame in which an object moves."""
    tracks, valid = fitter.model.tracks, fitter.valid
    places = fitter.model.predict(at.fit.point)
    gap = np.diff(tracks.times, axis=1)
    velocity = np.diff(places, axis=1) / np.maximum(gap, 1e-6)[..., None]
    speed = np.linalg.norm(velocity, axis=-1)
    moving = valid[:, 1:] & (speed > MOVING) & (gap > 0)
    spin = at.fit.point.latents[:, 4]
    values: dict[str, Array] = {
        "speed": speed,
        "time": tracks.times[:, 1:],
        "heading": np.arctan2(velocity[..., 1], velocity[..., 0]),
        "order": np.broadcast_to(tracks.order[:, None], speed.shape),
        "spin": np.broadcast_to(spin[:, None], speed.shape),
    }
    return values[variable][moving]


def against(
    fitter: HitFitter, at: Candidate, variable: Follows, edges: Array
) -> dict[str, tuple[Array, Array]]:
    """Push by bins of a variable, along the motion and to its left.

    Args:
        fitter: of the hits.
        at: the fit whose residuals are asked for.
        variable: one of those of `variable_of`.
        edges: (bins + 1,) ascending; what lies outside counts to the outer bins.

    Returns:
        along, left -> value and standard deviation (bins,) in m/s^2.
    """
    count = len(edges) - 1
    steps = [(f"{side}_{j}", f"{side}_{j + 1}") for side in SIDES for j in range(count - 1)]
    found = linear_estimate(fitter, at, binned_force(variable, edges), steps)
    bins = np.eye(count)
    return {side: found.at({f"{side}_{j}": one for j, one in enumerate(bins)}) for side in SIDES}


def edges_of(values: Array, bins: int = BINS) -> Array:
    """(bins + 1,) edges with equally many values between them; fewer where values repeat."""
    return np.unique(np.quantile(values, np.linspace(0, 1, bins + 1)))


def binned_force(variable: Follows, edges: Array) -> Effect:
    """A push along the motion and to its left that is constant in each bin of a variable."""
    count = len(edges) - 1

    class BinnedForce(Effect):
        name = "binned_force"
        phase = "slide"
        follows = variable
        parameters = tuple(
            Parameter(f"{side}_{j}", "m/s^2", -20.0, 20.0, 3 * _SCALE, "push in one bin")
            for side in SIDES
            for j in range(count)
        )
        physics = "No physics: a push that depends on one variable."
        source = ""

        def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
            """Each hit has the push of its bin."""
            which = np.clip(np.searchsorted(edges, _value(variable, state)) - 1, 0, count - 1)
            hits = np.arange(len(which))
            along, left = (
                np.stack([np.broadcast_to(values[f"{side}_{j}"], which.shape) for j in range(count)])[
                    which, hits
                ]
                for side in SIDES
            )
            return _turned(along, left, state)

    return BinnedForce()


class _PlaceAlong(Effect):
    """A push along the motion that depends on the place: friction that does so makes just this."""

    name = "place_along"
    phase = "slide"
    follows = "place"
    parameters = tuple(
        Parameter(f"along_{j}", "m/s^2", -2.0, 2.0, _SCALE, "weight of one bump")
        for j in range(len(COARSE_BOARD))
    )
    physics = "No physics: a push along the motion that depends on the place."
    source = ""

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        weights = np.array([values[f"along_{j}"] for j in range(len(COARSE_BOARD))])
        along = COARSE_BOARD.total(weights, state.x, state.y)
        return _turned(along, np.zeros_like(along), state)

    def reaches(self, parameter: str, places: Array) -> bool:
        """Bumps reach as far as they are wide."""
        return COARSE_BOARD.near(int(parameter.split("_")[1]), places)


def _turned(along: Array, left: Array, state: SlideState) -> tuple[Array, Array]:
    """(n,), (n,) along world x and y of a push along the motion and to its left."""
    speed = state.speed + 1e-9
    cosine, sine = state.vx / speed, state.vy / speed
    return along * cosine - left * sine, along * sine + left * cosine


def _value(variable: Follows, state: SlideState) -> Array:
    if variable == "heading":
        return np.arctan2(state.vy, state.vx)
    return getattr(state, variable)
