"""Prediction of held-out motions.

A window is predicted from a state that the model estimates from the preceding data, and from the recorded
controls; observations within the window are not used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.stats import chi2

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Innovations, Linear, innovations, leave_one_out, smooth
from slapshot.diagnosis.fit.fit import Fit, Fitter, prior_of
from slapshot.diagnosis.fit.linear import Perturbation, residuals
from slapshot.diagnosis.fit.noise import (
    CLIP,
    Noise,
    fit_noise,
    posterior_means,
    with_outliers,
)
from slapshot.diagnosis.fit.shooting import fit_first_states, simulate
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.structure import transferred_trajectory
from slapshot.diagnosis.selection.problem import NUISANCE, Problem
from slapshot.diagnosis.selection.pulses import (
    SET_ASIDE_ROUNDS,
    log_pushes,
    pushes_set_aside,
    windows_set_aside,
)
from slapshot.diagnosis.selection.steps import EQUIVALENCE_NATS, with_typical_errors
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

WINDOW_S = 0.5
_ROUNDS = 5
_CONVERGED = 1e-3  # convergence of a trajectory, relative to the noise
_MAX_STEP = 1.0  # largest accepted last step, relative to the noise
_SHOOTING_ROUNDS = 15
_MAX_GROWTH = 2.0  # largest growth of a segment's errors in a step
_RESAMPLES, _FEW = 1000, 5  # of windows; fewer than these may all be above the mean by chance
_SAME_TIME_S = 1e-6
# Standard deviations by which a reading is off that is no reading, whatever force acts; the nodes around one
# that it throws off, too; and how often others are looked for once the worst are out.
_NO_READING, _NEAR_NODES, _READING_ROUNDS = 10.0, 4, 5
_NO_WEIGHT = 1e12  # factor on the variance of unused observations


@dataclass(frozen=True)
class Predictions:
    """Predictions of W windows.

    Attributes:
        error: (W, nodes, ny) recorded less predicted, and less coloured noise estimated from the preceding
            data; NaN where nothing was recorded.
        predicted: (W, nodes, ny).
        floor: (W, nodes, ny) standard deviation of the error from noise alone.
        expected: (W, nodes, ny) the same including errors of the time step, of fitted values and of laws; of
            named ones at least as large as is typical of such laws.
        log_likelihood: (W,) of what was recorded in the windows, given the data before.
        correlation: (ny, nodes, nodes) of the noise of a channel's readings.
    """

    error: Array
    predicted: Array
    floor: Array
    expected: Array
    log_likelihood: Array
    correlation: Array

    def rms(self, columns: NDArray[np.intp]) -> float:
        """Root mean square error of some channels."""
        return float(np.sqrt(np.nanmean(self.error[..., columns] ** 2)))

    def rms_floor(self, columns: NDArray[np.intp]) -> float:
        """Root mean square error of some channels that noise alone would make."""
        there = np.isfinite(self.error[..., columns])
        return float(np.sqrt(np.mean(self.floor[..., columns][there] ** 2)))

    def excess(self, rng: np.random.Generator) -> tuple[float, float]:
        """Reduced chi² of the errors: 99 % bootstrap interval over windows.

        Errors beyond four standard deviations, as of outliers, count as four. A few windows may all be above
        the mean by chance, since errors last: within each, those of a first place and speed of each channel
        do. Of these the lower end is no higher than chi² allows.
        """
        each = np.nanmean(np.minimum((self.error / self.expected) ** 2, CLIP**2), axis=(1, 2))
        each = each[np.isfinite(each)]
        picks = rng.integers(0, len(each), (_RESAMPLES, len(each)))
        low, high = np.quantile(each[picks].mean(axis=1), [0.005, 0.995])
        if len(each) < _FEW:
            count = 2 * self.error.shape[-1] * len(each)
            low = min(low, each.mean() * count / chi2.ppf(0.995, count))
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
    trajectory: Array,
    precision: Array | None = None,
) -> Predictions:
    """Predict the second half of every segment from its first.

    Args:
        problem: whose rig the hypothesis is on.
        hypothesis: effects.
        theta: their values.
        windows: held-out segments of two window lengths.
        noise: of the hypothesis, fitted elsewhere.
        trajectory: (W, 2 n, nx) initial guess.
        precision: (p, p) of the values; None where they are given.
    """
    windows, half = problem.in_steps(windows), windows.shape[1] // 2
    masked = windows.y.copy()
    masked[:, half:] = np.nan
    before = replace(windows, y=masked)
    own = problem.noise_on(windows, trajectory, noise)
    fitter = Fitter(problem.fitter.simulator, before, problem.torque)
    if _has_hidden_state(hypothesis):
        trajectory = fit_first_states(
            fitter.simulator, hypothesis, theta, fitter.segments, trajectory, own, _SHOOTING_ROUNDS
        )
    trajectory, coloured = _smoothed(fitter, hypothesis, theta, trajectory, own)
    later, _ = simulate(fitter.simulator, hypothesis, theta, windows.later(half), trajectory[:, half])
    trajectory = np.concatenate(
        [trajectory[:, :half], np.where(np.isfinite(later), later, trajectory[:, half:])], axis=1
    )
    found = fitter.linearise(hypothesis, theta, trajectory)
    system, predicted = found.system.without_columns(), found.predicted
    quiet = replace(own, force=1e-6)
    floor = np.sqrt(innovations(system, quiet.covariances(windows.interval)).variance)
    whole = replace(fitter, segments=windows)
    there = whole.linearise(hypothesis, theta, trajectory, jacobian=found.system).system.without_columns()
    covariances = own.covariances(windows.interval)
    all_of_it, first = innovations(there, covariances), innovations(system, covariances)
    log_likelihoods = -0.5 * (
        np.sum(all_of_it.e**2, axis=(1, 2)) + all_of_it.logdet
        - np.sum(first.e**2, axis=(1, 2)) - first.logdet
    )  # fmt: skip
    error = residuals(problem.rig, windows, predicted + coloured)[:, half:]
    # Responses of all columns given the data before the windows: observations within them get no weight.
    blind = quiet.weight.copy()
    blind[:, half:] = _NO_WEIGHT
    laws = problem.law_columns.on(fitter.simulator, hypothesis, theta, windows, trajectory)
    drifts = problem.drifts(windows)
    wide = Fitter(fitter.simulator, windows, problem.torque, NUISANCE, problem.rig_motion, laws, drifts)
    columns, prior = wide.system(hypothesis, theta, trajectory, jacobian=system)
    seen = innovations(columns, replace(quiet, weight=blind).covariances(windows.interval))
    response = (seen.Z * np.sqrt(seen.variance)[..., None])[:, half:]
    p = len(theta)
    allowed = with_typical_errors(noise, hypothesis)
    spread = np.sum((response[..., p:] * prior.at(allowed)[p:]) ** 2, axis=-1)
    if precision is not None and p:
        own_part = response[..., :p]
        spread = spread + np.einsum("wtck,kl,wtcl->wtc", own_part, np.linalg.inv(precision), own_part)
    expected = np.sqrt(floor[:, half:] ** 2 + spread)
    correlation = noise.correlation(half, windows.interval)
    return Predictions(error, predicted[:, half:], floor[:, half:], expected, log_likelihoods, correlation)


def without_wrong_readings(
    problem: Problem, hypothesis: Hypothesis, theta: Array, windows: Segments, noise: Noise
) -> Segments:
    """Windows without readings that no motion explains, of which no fit has told that they are outliers.

    One such reading would decide which model predicts better. Judged by the others of its segment under a
    process force as large as all that acts, and not by what a model lacks; the same for all models.

    Args:
        problem: of the nominal rig.
        hypothesis: nominal.
        theta: its values.
        windows: held-out segments.
        noise: of the nominal model, fitted elsewhere.
    """
    for _ in range(_READING_ROUNDS):
        fine = problem.in_steps(windows)
        trajectory = recorded_trajectory(problem.rig, fine)
        own = problem.noise_on(fine, trajectory, noise)
        covering = replace(own, force=max(1.0, own.force))
        fitter = Fitter(problem.simulator, fine, problem.torque)
        trajectory, _ = _smoothed(fitter, hypothesis, theta, trajectory, covering)
        system = fitter.linearise(hypothesis, theta, trajectory).system.without_columns()
        residual, variance = leave_one_out(system, covering.covariances(fine.interval))
        with np.errstate(invalid="ignore", divide="ignore"):
            size = np.where(np.isfinite(windows.y), np.abs(residual) / np.sqrt(variance), 0.0)
        worst = size == maximum_filter1d(size, 2 * _NEAR_NODES + 1, axis=1)
        wrong = worst & (size > _NO_READING)
        if not wrong.any():
            break
        windows = replace(windows, y=np.where(wrong, np.nan, windows.y))
    return windows


@dataclass(frozen=True)
class HeldOutPush:
    """A push in held-out data.

    Attributes:
        joint: that is pushed.
        pulse: when.
        force: N m or N, mean over it.
        unit: of the force.
    """

    joint: str
    pulse: Pulse
    force: float
    unit: str

    def __str__(self) -> str:
        p = self.pulse
        return (
            f"in held-out data, about {self.force:.3g} {self.unit} push {self.joint} from {p.begin:.2f} to "
            f"{p.end:.2f} s of episode {p.episode}; no model here has that push"
        )


def windows_with(pushes: Sequence[HeldOutPush], windows: Segments) -> NDArray[np.bool_]:
    """(W,) windows in which some of these pushes act."""
    found = np.zeros(windows.shape[0], bool)
    for push in pushes:
        found |= _during(push.pulse, windows).any(axis=1)
    return found


def pushes_in(
    problem: Problem,
    hypothesis: Hypothesis,
    fit: Fit,
    segments: Segments,
    held: NDArray[np.intp],
    noise: Noise,
    trajectory: Array,
) -> list[HeldOutPush]:
    """Enormous pushes in held-out data, which no fit saw, by the spread of the forces in all windows.

    Args:
        problem: whose rig the hypothesis is on.
        hypothesis: effects, without hidden states.
        fit: their values.
        segments: all that was recorded.
        held: indices of the segments that are held out.
        noise: of the hypothesis, fitted to the others.
        trajectory: (S, L, nx) initial guess.
    """
    segments = problem.in_steps(segments)
    own = problem.noise_on(segments, trajectory, noise)
    plain = Fitter(problem.simulator, segments, problem.torque)
    trajectory, _ = _smoothed(plain, hypothesis, fit.theta, trajectory, own)
    laws = problem.law_columns.on(problem.simulator, hypothesis, fit.theta, segments, trajectory)
    drifts, motion = problem.drifts(segments), problem.rig_motion
    wide = replace(plain, nuisance=NUISANCE, rig=motion, law_errors=laws, drifts=drifts)
    system, prior = wide.system(hypothesis, fit.theta, trajectory)
    sd = prior.at(own)
    sd[: len(fit.theta)] = fit.sd
    # A process force that covers all pushes at first, and then only what is no push.
    forces = np.geomspace(max(1.0, own.force), own.force, SET_ASIDE_ROUNDS)
    # No fit has told which readings of held-out data are outliers: one would be a short, enormous push.
    covering = replace(own, force=float(forces[0]))
    values = posterior_means(innovations(system, covering.covariances(segments.interval)), sd)
    own = with_outliers(system.moved(values), covering, segments.interval)
    for force in forces:
        own = replace(own, force=float(force))
        values = posterior_means(innovations(system, own.covariances(segments.interval)), sd)
        speed = problem.speed(trajectory)
        own = replace(own, set_aside=windows_set_aside(system, values, speed, own, segments, motion))
    system = system.moved(values)
    known = [pulse for e in hypothesis.effects if isinstance(e, ExternalPulse) for pulse in e.pulses]
    covariances = own.without_set_aside.covariances(segments.interval)
    found = []
    for push, _ in pushes_set_aside(system, own, segments, motion, known):
        joint = next(joint for joint in motion.joints if joint.name == push.part)
        W = np.zeros((*system.W.shape[:3], len(push.pulses)))
        for k, pulse in enumerate(push.pulses):
            during = _during(pulse, segments)
            W[during, :, k] = system.B[during][..., joint.v]
        alone = system.with_columns(W, np.zeros((*system.psi.shape[:3], len(push.pulses))))
        seen = innovations(alone, covariances)
        sizes = posterior_means(seen, np.full(len(push.pulses), joint.torque))
        # Each may have begun in any window on any joint, and its edges were fitted (see `pushes_set_aside`).
        gains = _gains_without_a_reading(seen)
        least = log_pushes(segments, motion) + EQUIVALENCE_NATS
        found += [
            HeldOutPush(push.part, pulse, float(force), joint.unit)
            for pulse, force, gain in zip(push.pulses, sizes, gains, strict=True)
            if gain > least and _during(pulse, segments)[held].any()
        ]
    return found


def _gains_without_a_reading(seen: Innovations) -> Array:
    """(p,) nats that each column gains without the reading that speaks for it most.

    The last reading of a segment may be wrong, or pushed: it takes two to tell.
    """
    z = seen.Z.reshape(seen.e.size, -1)
    own, information = z * seen.e.reshape(-1, 1), z**2
    left = np.maximum(information.sum(0) - information, 0.0)
    gains = np.divide((own.sum(0) - own) ** 2, 2 * left, out=np.zeros_like(own), where=left > 1e-12)
    return np.asarray(gains.min(0, where=information > 0, initial=np.inf))


def _during(pulse: Pulse, segments: Segments) -> NDArray[np.bool_]:
    """(S, L) nodes at which a pulse acts."""
    acts = (segments.time > pulse.begin - _SAME_TIME_S) & (segments.time < pulse.end - _SAME_TIME_S)
    return np.asarray(acts & (segments.ids[segments.episode] == pulse.episode)[:, None])


def _has_hidden_state(hypothesis: Hypothesis) -> bool:
    """Whether a model has hidden states that smoothing cannot find, such as the side of a backlash."""
    return any(effect.hidden_state for effect in hypothesis.effects)


@np.errstate(over="ignore", invalid="ignore")
def _smoothed(
    fitter: Fitter,
    hypothesis: Hypothesis,
    theta: Array,
    trajectory: Array,
    noise: Noise,
    known: Linear | None = None,
) -> tuple[Array, Array]:
    """Smoothed trajectory and coloured noise at fixed values; `known` is a system about a nearby trajectory.

    Where a step increases the error, as across a backlash, the segment takes a shorter one.
    """
    system, covariances = known, noise.covariances(fitter.segments.interval)
    there = np.isfinite(fitter.segments.y).sum(axis=(1, 2))
    best, least, share = trajectory, np.full(len(trajectory), np.inf), np.ones(len(trajectory))
    step, coloured = (
        np.zeros((*trajectory.shape[:2], fitter.simulator.tangent.dim)),
        np.zeros(fitter.segments.y.shape),
    )
    moved = np.zeros(len(trajectory))
    for number in range(_ROUNDS):
        # A trajectory nearby has nearly the same derivatives.
        jacobian = system if known is not None or number > 1 else None
        system = fitter.linearise(hypothesis, theta, trajectory, jacobian=jacobian).system.without_columns()
        squares = np.sum(innovations(system, covariances).e ** 2, axis=(1, 2))
        good = (squares < _MAX_GROWTH * np.maximum(least, there)) | (number == 0)
        best = np.where(good[:, None, None], trajectory, best)
        least, share = np.where(good, np.minimum(squares, least), least), np.where(good, 1.0, share / 4)
        delta, _, smoothed = smooth(system, covariances)
        step[good], coloured[good] = delta[good], smoothed[good]
        taken = share[:, None, None] * step
        trajectory = fitter.simulator.tangent.add(best, taken)
        moved = np.sqrt(
            np.mean(np.einsum("stcn,stn->stc", system.C, taken) ** 2 / noise.single_variance, axis=(1, 2))
        )
        if np.sqrt(np.mean(moved**2)) < _CONVERGED:
            break
    return np.where((moved < _MAX_STEP)[:, None, None], trajectory, best), coloured


def refitted_noise(
    problem: Problem, hypothesis: Hypothesis, theta: Array, trajectory: Array, noise: Noise
) -> tuple[Noise, Array]:
    """Refit the noise of a hypothesis at fixed values, and its trajectory."""
    for _ in range(2):
        system = problem.fitter.linearise(hypothesis, theta, trajectory).system.without_columns()
        nothing: tuple[Perturbation, ...] = ()
        prior = prior_of(Hypothesis(problem.rig), nothing)
        noise = fit_noise(system, prior, noise, problem.segments, problem.quantities, near=True)
        if _has_hidden_state(hypothesis):
            break
        trajectory, _ = _smoothed(problem.fitter, hypothesis, theta, trajectory, noise, system)
    return noise, trajectory


def initial_trajectory(problem: Problem, nominal: Problem, windows: Segments) -> Array:
    """Initial guess of the windows' trajectory; restructured rigs start without deflection."""
    trajectory = recorded_trajectory(nominal.rig, windows)
    if problem.rig is nominal.rig:
        return trajectory
    return transferred_trajectory(nominal.rig, problem.rig, None, windows, trajectory)
