"""Misfit of a model along the recorded motion: a force on each joint, or an error of its readings.

The force is a white process force that the smoother may use to follow the recording; errors of readings are
the residuals of the smoothed trajectory without it. The error of the model's time step is taken out of both.
Means over bins have intervals from the spread between segments, which holds whatever correlates samples
within one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import smooth
from slapshot.diagnosis.fit.linear import STEP_ERROR
from slapshot.diagnosis.report.outcome import Coordinate, Outcome, coordinates
from slapshot.diagnosis.report.presentation import Z90

_FORCE = 0.2  # process force as a share of the torque that moves each joint
_ROUNDS = 2
_END = 0.12  # share of a segment at either end, where a force is poorly determined
_BINS = 16
_MIN_SEGMENTS = 3  # segments in a bin with an interval


@dataclass(frozen=True)
class Misfit:
    """Misfit of one model at n samples of the recording.

    Attributes:
        force: (n, coordinates) N m or N.
        reading: (n, ny) recorded less smoothed, in units of the channels; NaN where nothing was recorded.
        segment: (n,) index of the segment.
    """

    force: Array
    reading: Array
    segment: NDArray[np.intp]


def misfit(outcome: Outcome, model_name: str) -> Misfit:
    """Misfit of a model along the segments used for fitting."""
    step, prediction = outcome.step(model_name), outcome.by_model[model_name]
    problem, scored = step.problem, step.scored
    kept = interior_samples(outcome)

    def smoothed(force: float) -> tuple[Array, Array]:
        noise = replace(scored.noise, force=max(force, scored.noise.force))
        covariances = noise.covariances(problem.segments.interval)
        trajectory = scored.fit.trajectory
        for _ in range(_ROUNDS):
            hypothesis, theta = prediction.hypothesis, prediction.theta
            system = problem.fitter.linearise(hypothesis, theta, trajectory, [STEP_ERROR]).system
            values = np.append(np.zeros(len(theta)), STEP_ERROR.scale)
            system = system.moved(values).without_columns()
            delta, pushed, _ = smooth(system, covariances)
            trajectory = problem.fitter.simulator.tangent.add(trajectory, delta)
        left = system.r - np.einsum("stij,stj->sti", system.C, delta)
        return pushed, left

    pushed, _ = smoothed(_FORCE)
    _, left = smoothed(0.0)
    model = problem.rig.model
    dofs = [int(model.joint(c.joint).dofadr[0]) + c.axis for c in coordinates(outcome.rig.model)]
    return Misfit(pushed[..., dofs][kept], left[kept], np.nonzero(kept)[0])


def added_force(outcome: Outcome) -> Array | None:
    """(n, coordinates) force that the augmented model adds to the nominal one, at the same samples.

    It is the held force that has the same effect on the next state; None where nothing was named, or where
    the augmented model has states of its own.
    """
    before, after = outcome.search.nominal, outcome.search.final
    if "augmented" not in outcome.by_model or after.problem.rig is not before.problem.rig:
        return None
    trajectory, problem = before.scored.fit.trajectory, before.problem
    base, model_name = outcome.by_model[next(iter(outcome.by_model))], outcome.by_model["augmented"]
    plain = problem.fitter.linearise(base.hypothesis, base.theta, trajectory).system
    more = problem.fitter.linearise(model_name.hypothesis, model_name.theta, trajectory).system
    force = np.einsum("stij,stj->sti", np.linalg.pinv(plain.B), more.d - plain.d)
    dofs = [c.v for c in coordinates(outcome.rig.model)]
    return force[..., dofs][interior_samples(outcome)]


def interior_samples(outcome: Outcome) -> NDArray[np.bool_]:
    """(S, L) samples at which forces are well determined."""
    segments = outcome.search.nominal.problem.segments
    nodes = np.arange(segments.shape[1])
    length = segments.inside.sum(1, keepdims=True)
    return segments.inside & (nodes >= _END * length) & (nodes < (1 - _END) * length - 1)


def variables(outcome: Outcome, coordinate: Coordinate) -> dict[str, Array]:
    """Variables of a mismatch, at the same samples: of the nominal model's smoothed trajectory."""
    step, kept = outcome.search.nominal, interior_samples(outcome)
    problem, fit = step.problem, step.scored.fit
    segments = problem.segments
    found = {
        "velocity": fit.trajectory[..., problem.rig.model.nq + coordinate.v][kept],
        "load": _torque(outcome)[..., coordinate.v][kept],
        "time": segments.time[kept],
        "session": np.repeat(segments.order[:, None], segments.shape[1], 1)[kept],
    }
    if coordinate.q is not None:
        found["position"] = fit.trajectory[..., coordinate.q][kept]
    return found


def _torque(outcome: Outcome) -> Array:
    step = outcome.search.nominal
    fit = step.scored.fit
    return step.problem.fitter.linearise(fit.hypothesis, fit.theta, fit.trajectory).torque


def binned(
    at: Array, value: Array, segment: NDArray[np.intp], edges: Array, fewest: int = _MIN_SEGMENTS
) -> pd.DataFrame:
    """Mean with its 90 % interval in each bin; bins that too few segments reach are left out.

    Args:
        at: (n,) variable.
        value: (n,) what is averaged; NaN where there is none.
        segment: (n,) index of the segment.
        edges: (bins + 1,) increasing.
        fewest: segments in a bin that is not left out.

    Returns:
        Columns at (mean of the variable), value, low, high; the last two are NaN where segments are too few
        for an interval.
    """
    there = np.isfinite(value) & (at >= edges[0]) & (at <= edges[-1])
    at, value, segment = at[there], value[there], segment[there]
    which = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(edges) - 2)
    rows = []
    for k in range(len(edges) - 1):
        own = which == k
        _, of = np.unique(segment[own], return_inverse=True)
        count = len(np.bincount(of)) if own.any() else 0
        if count < fewest:
            continue
        weight = np.bincount(of).astype(float)
        means = np.bincount(of, value[own]) / weight
        mean = float(np.average(means, weights=weight))
        half = np.nan
        if count >= _MIN_SEGMENTS:
            variance = np.sum((weight * (means - mean)) ** 2) / weight.sum() ** 2 * count / (count - 1)
            half = Z90 * float(np.sqrt(variance))
        rows.append({"at": float(at[own].mean()), "value": mean, "low": mean - half, "high": mean + half})
    return pd.DataFrame(rows, columns=["at", "value", "low", "high"])


def edges_of(at: Array, variable: str, bins: int = _BINS) -> Array:
    """Edges of bins: of equal width where most samples lie; of sessions one an episode."""
    if variable == "session":
        values = np.unique(at)
        if len(values) <= 2 * bins:
            middle = (values[1:] + values[:-1]) / 2
            return np.concatenate([[values[0] - 0.01], middle, [values[-1] + 0.01]])
    low, high = np.quantile(at, [0.005, 0.995])
    if not high > low:
        low, high = low - 0.5, high + 0.5
    return np.linspace(low, high, bins + 1)


def by_variable(
    outcome: Outcome,
    coordinate: Coordinate,
    variable: str,
    of: Callable[[Misfit], Array],
    by_model: dict[str, Misfit],
) -> pd.DataFrame:
    """Binned means of each model's misfit over one variable; one row for each model and bin.

    Where segments do not meet in any bin, as over the time of a single episode, means have no intervals.

    Args:
        outcome: of the diagnosis.
        coordinate: whose variable it is.
        variable: key of `variables`.
        of: selects a force or reading error, (n,).
        by_model: misfit of each model.
    """
    at = variables(outcome, coordinate)[variable]

    def tables(bins: int, fewest: int) -> list[pd.DataFrame]:
        edges = edges_of(at, variable, bins)
        return [
            binned(at, of(misfit), misfit.segment, edges, fewest).assign(model=model_name)
            for model_name, misfit in by_model.items()
        ]

    for bins in (_BINS, _BINS // 2, _BINS // 4):  # fewer where segments hardly meet in one
        found = tables(bins, _MIN_SEGMENTS)
        if min(map(len, found)) >= bins / 2:
            break
    if not any(map(len, found)):
        found = tables(_BINS, 1)
    return pd.concat(found, ignore_index=True)
