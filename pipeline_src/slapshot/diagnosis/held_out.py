"""How well are motions predicted that took no part in fitting?

A window is predicted from a state that the model itself estimates from the data before it, and from the
recorded controls; nothing that was recorded within the window is used.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.filter import Linear, innovations, smooth
from slapshot.diagnosis.fit import Fitter, prior_of
from slapshot.diagnosis.hypothesis import Hypothesis
from slapshot.diagnosis.linear import Look, residuals
from slapshot.diagnosis.noise import CLIP, Noise, fit_noise
from slapshot.diagnosis.problem import NUISANCE, Problem
from slapshot.diagnosis.recorded_trajectory import recorded_path
from slapshot.diagnosis.segments import Segments
from slapshot.diagnosis.shooting import shoot, simulate
from slapshot.diagnosis.structure import moved_path

WINDOW_S = 0.5
_ROUNDS = 5
_STILL = 1e-3  # of the noise, by which a path may still move
_MOVING = 1.0  # of the noise, by which the last step of a path may still move it
_SHOT_ROUNDS = 15
_WORSE = 2.0  # factor by which errors of a segment may grow in a step
_RESAMPLES = 1000
_NO_WEIGHT = 1e12  # factor on the variance of what is not to be used


@dataclass(frozen=True)
class Predictions:
    """Predictions of W windows.

    Attributes:
        error: (W, nodes, ny) recorded less predicted, and less what is known of coloured noise from the data
            before; NaN where nothing was recorded.
        predicted: (W, nodes, ny).
        floor: (W, nodes, ny) standard deviation of the error that noise alone would make.
        expected: (W, nodes, ny) the same with errors of the time step, of laws and of fitted values.
        log_likelihood: (W,) of what was recorded in the windows, given the data before.
    """

    error: Array
    predicted: Array
    floor: Array
    expected: Array
    log_likelihood: Array

    def rms(self, columns: NDArray[np.intp]) -> float:
        """Root mean square error of some channels."""
        return float(np.sqrt(np.nanmean(self.error[..., columns] ** 2)))

    def rms_floor(self, columns: NDArray[np.intp]) -> float:
        """Root mean square error of some channels that noise alone would make."""
        there = np.isfinite(self.error[..., columns])
        return float(np.sqrt(np.mean(self.floor[..., columns][there] ** 2)))

    def excess(self, rng: np.random.Generator) -> tuple[float, float]:
        """Mean square of errors over what is expected: 99 % bootstrap interval over windows.

        Errors beyond four standard deviations, as of outliers, count as four.
        """
        each = np.nanmean(np.minimum((self.error / self.expected) ** 2, CLIP**2), axis=(1, 2))
        each = each[np.isfinite(each)]
        picks = rng.integers(0, len(each), (_RESAMPLES, len(each)))
        low, high = np.quantile(each[picks].mean(axis=1), [0.005, 0.995])
        return float(low), float(high)

    def squares(self, columns: NDArray[np.intp]) -> Array:
        """(W,) mean squared error of each window."""
        return np.nanmean(self.error[..., columns] ** 2, axis=(1, 2))


def predict(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    windows: Segments,
    noise: Noise,
    path: Array,
    precision: Array | None = None,
) -> Predictions:
    """Predict the second half of every segment from its first.

    Args:
        problem: whose rig the hypothesis is on.
        hypothesis: effects.
        theta: their values.
        windows: held-out segments of two window lengths.
        noise: of the hypothesis, fitted elsewhere.
        path: (W, 2 n, nx) where the first states are looked for.
        precision: (p, p) of the values; None where they are given.
    """
    windows, half = problem.in_steps(windows), windows.shape[1] // 2
    masked = windows.y.copy()
    masked[:, half:] = np.nan
    before = replace(windows, y=masked)
    own = noise.elsewhere(problem.rates(windows, path))
    fitter = Fitter(problem.fitter.simulator, before, problem.torque)
    if _rough(hypothesis):
        path = _shot(fitter, hypothesis, theta, path, own)
    path, coloured = _without_parameters(fitter, hypothesis, theta, path, own)
    later, _ = simulate(fitter.simulator, hypothesis, theta, windows.later(half), path[:, half])
    path = np.concatenate([path[:, :half], np.where(np.isfinite(later), later, path[:, half:])], axis=1)
    found = fitter.linearise(hypothesis, theta, path)
    system, predicted = found.system.without_columns(), found.predicted
    quiet = replace(own, force=1e-6)
    floor = np.sqrt(innovations(system, quiet.covariances(windows.interval)).variance)
    whole = replace(fitter, segments=windows)
    there = whole.linearise(hypothesis, theta, path).system.without_columns()
    covariances = own.covariances(windows.interval)
    all_of_it, first = innovations(there, covariances), innovations(system, covariances)
    log_likelihoods = -0.5 * (
        np.sum(all_of_it.e**2, axis=(1, 2)) + all_of_it.logdet
        - np.sum(first.e**2, axis=(1, 2)) - first.logdet
    )  # fmt: skip
    error = residuals(problem.rig, windows, predicted + coloured)[:, half:]
    # All columns' responses to what is known at the windows' beginning: what comes then is given no weight.
    blind = quiet.weight.copy()
    blind[:, half:] = _NO_WEIGHT
    laws = problem.law_columns.on(fitter.simulator, hypothesis, theta, windows, path)
    drifts = problem.drifts(windows)
    wide = Fitter(fitter.simulator, windows, problem.torque, NUISANCE, problem.situation, laws, drifts)
    columns, prior = wide.system(hypothesis, theta, path, jacobian=system)
    seen = innovations(columns, replace(quiet, weight=blind).covariances(windows.interval))
    response = (seen.Z * np.sqrt(seen.variance)[..., None])[:, half:]
    p = len(theta)
    spread = np.sum((response[..., p:] * prior.at(noise)[p:]) ** 2, axis=-1)
    if precision is not None and p:
        own_part = response[..., :p]
        spread = spread + np.einsum("wtck,kl,wtcl->wtc", own_part, np.linalg.inv(precision), own_part)
    expected = np.sqrt(floor[:, half:] ** 2 + spread)
    return Predictions(error, predicted[:, half:], floor[:, half:], expected, log_likelihoods)


def _rough(hypothesis: Hypothesis) -> bool:
    """Whether a model has states that smoothing does not find from afar: on which side a gear's teeth lie."""
    return any(effect.hidden_state for effect in hypothesis.effects)


def _shot(fitter: Fitter, hypothesis: Hypothesis, theta: Array, path: Array, noise: Noise) -> Array:
    """A path from the first states that explain each segment best by themselves."""
    path = path.copy()
    for one in np.arange(len(path))[:, None]:
        segments, own = fitter.segments.select(one), noise.select(one)
        path[one] = shoot(
            fitter.simulator, hypothesis, theta, segments, path[one], own, _SHOT_ROUNDS, held=True
        ).path
    return path


@np.errstate(over="ignore", invalid="ignore")
def _without_parameters(
    fitter: Fitter,
    hypothesis: Hypothesis,
    theta: Array,
    path: Array,
    noise: Noise,
    known: Linear | None = None,
) -> tuple[Array, Array]:
    """Smoothed path and coloured noise with the values held; `known` is a system about a path nearby.

    Where a step leads to a path that cannot be, as across a gap of teeth, a segment takes a shorter one.
    """
    system, covariances = known, noise.covariances(fitter.segments.interval)
    there = np.isfinite(fitter.segments.y).sum(axis=(1, 2))
    best, least, share = path, np.full(len(path), np.inf), np.ones(len(path))
    step, coloured = (
        np.zeros((*path.shape[:2], fitter.simulator.tangent.dim)),
        np.zeros(fitter.segments.y.shape),
    )
    moved = np.zeros(len(path))
    for number in range(_ROUNDS):
        # A path nearby has nearly the same derivatives.
        jacobian = system if known is not None or number > 1 else None
        system = fitter.linearise(hypothesis, theta, path, jacobian=jacobian).system.without_columns()
        squares = np.sum(innovations(system, covariances).e ** 2, axis=(1, 2))
        good = (squares < _WORSE * np.maximum(least, there)) | (number == 0)
        best = np.where(good[:, None, None], path, best)
        least, share = np.where(good, np.minimum(squares, least), least), np.where(good, 1.0, share / 4)
        delta, _, smoothed = smooth(system, covariances)
        step[good], coloured[good] = delta[good], smoothed[good]
        taken = share[:, None, None] * step
        path = fitter.simulator.tangent.add(best, taken)
        moved = np.sqrt(
            np.mean((np.einsum("stcn,stn->stc", system.C, taken) / noise.white) ** 2, axis=(1, 2))
        )
        if np.sqrt(np.mean(moved**2)) < _STILL:
            break
    return np.where((moved < _MOVING)[:, None, None], path, best), coloured


def own_noise(
    problem: Problem, hypothesis: Hypothesis, theta: Array, path: Array, noise: Noise
) -> tuple[Noise, Array]:
    """Noise of a hypothesis whose values are held, and the path under it."""
    for _ in range(2):
        system = problem.fitter.linearise(hypothesis, theta, path).system.without_columns()
        nothing: tuple[Look, ...] = ()
        prior = prior_of(Hypothesis(problem.rig), nothing)
        noise = fit_noise(system, prior, noise, problem.segments, problem.kinds, near=True)
        if _rough(hypothesis):
            break
        path, _ = _without_parameters(problem.fitter, hypothesis, theta, path, noise, system)
    return noise, path


def first_path(problem: Problem, nominal: Problem, windows: Segments) -> Array:
    """Where first states of windows are looked for; restructured rigs begin without deflection."""
    path = recorded_path(nominal.rig, windows)
    if problem.rig is nominal.rig:
        return path
    names = {problem.rig.model.joint(j).name for j in range(problem.rig.model.njnt)}
    added = next(e for e in nominal.catalogue if e.hidden_state and e.added_joint in names)
    return moved_path(nominal.rig, problem.rig, added, windows, path)
