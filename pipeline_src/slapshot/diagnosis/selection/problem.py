"""The problem: segments of a recording, the nominal rig, and candidate effects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.control_errors import control_errors
from slapshot.diagnosis.fit.filter import Innovations, Linear, innovations, smooth
from slapshot.diagnosis.fit.fit import Fit, Fitter
from slapshot.diagnosis.fit.law_columns import LawColumns, law_columns
from slapshot.diagnosis.fit.law_error import law_errors
from slapshot.diagnosis.fit.linear import STEP_ERROR, Perturbation, perturbations_of
from slapshot.diagnosis.fit.noise import (
    LARGEST_LAW_ERROR,
    TYPICAL_LAW_ERROR,
    Noise,
    Prior,
    fit_noise,
    fit_process_force,
    initial_noise,
    marginal_likelihood,
    posterior_means,
)
from slapshot.diagnosis.inference.mismatch_test import (
    Eliminated,
    Elimination,
    Gain,
    Scores,
    gains,
    scores,
)
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator, actuator_torque
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.rig_motion import rig_motion, torque_scale
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.structure import (
    reindexed_motion,
    restructured,
    substeps_for,
    transferred_trajectory,
)
from slapshot.diagnosis.selection.free_forms import free_forms, is_free
from slapshot.diagnosis.selection.pulses import (
    SET_ASIDE_ROUNDS,
    Scan,
    least_worth,
    push_error,
    scan,
    windows_set_aside,
)
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import JointEffect, RigMotion, State
from slapshot.effects.joints.external_pulse import ExternalPulse
from slapshot.effects.joints.split import FASTEST
from slapshot.recordings.channels import Channel

_BALL, _FREE = mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_FREE
NUISANCE = (STEP_ERROR,)  # of every hypothesis, besides law errors
POSITION_SPREAD = 0.05  # rad or m, prior sd of an initial state about the trajectory
_SPEED_SPREAD = 3  # rms speeds
_UNKNOWN_ANGLE = 1.0  # rad, prior sd of an initial angle that nothing observes
CREDIBLE_SD = 5.0  # of a prior, beyond which a value contradicts it
_DRIFT_WIDTH = 0.1  # length scale of drift, as a share of the session
_LAW_ERROR_MARGIN = 2.0  # of the largest law error in fits, as a factor on the fitted one
# Rms by which a trajectory may follow the noise of the readings, in its standard deviations, and most rounds.
_FOLLOWED, _SMOOTHER_ROUNDS = 0.3, 8
# Refits of the noise after outliers were down-weighted, until logarithms of weights change by less.
_OUTLIER_ROUNDS, _SAME_WEIGHTS = 4, 3e-3
_NEGLIGIBLE = 1e-9  # rms of shapes of drift where there is but one episode


@dataclass(frozen=True)
class Problem:
    """Segments to be explained.

    Attributes:
        rig: nominal, or restructured.
        channels: what was recorded.
        segments: data.
        rig_motion: scales of the motion.
        trajectory: initial trajectory of fits.
        laws: perturbations for the shapes of errors of each nominal law.
        threads: for simulation.
        fine: whether law errors are large enough to need all shapes.
        chosen_law_columns: columns of law errors chosen before; None if not chosen.
    """

    rig: Rig
    channels: dict[str, Channel]
    segments: Segments
    rig_motion: RigMotion
    trajectory: Array
    torque: Array
    laws: tuple[Sequence[Perturbation], ...]
    threads: int = 1
    fine: bool = False
    chosen_law_columns: LawColumns | None = None

    @classmethod
    def of(cls, rig: Rig, channels: dict[str, Channel], segments: Segments, threads: int = 1) -> "Problem":
        """The problem of recorded segments."""
        trajectory = recorded_trajectory(rig, segments)
        scales = rig_motion(rig, segments, trajectory)
        torque = torque_scale(rig, segments, trajectory)
        laws = _laws(rig, segments, scales, trajectory)
        return cls(rig, channels, segments, scales, trajectory, torque, laws, threads)

    def restructured(self, effect: JointEffect, trajectory: Array) -> "Problem":
        """The problem restructured by an effect, with its trajectory transferred."""
        rig = restructured(self.rig, effect, self.channels)
        moved = transferred_trajectory(self.rig, rig, effect, self.segments, trajectory)
        scales = reindexed_motion(self.rig_motion, rig)
        # Added degrees of freedom have no actuator and little mass: low process force.
        torque = np.full(rig.model.nv, 1e-3 * float(np.min(self.torque)))
        kept = np.setdiff1d(np.arange(rig.model.nv), rig.added_dofs)
        torque[kept] = np.delete(self.torque, self.rig.added_dofs)
        segments = self.segments.finer(substeps_for(self.segments.step, min(effect.fastest, FASTEST)))
        laws = _laws(rig, segments, scales, moved, self.fine)
        return Problem(rig, self.channels, segments, scales, moved, torque, laws, self.threads, self.fine)

    def along(self, trajectory: Array, fine: bool = False) -> "Problem":
        """The problem with law errors along a fitted trajectory, with all shapes or the identifiable ones.

        Along the recorded trajectory, the force of a stiff servo contains the readings' noise, so that errors
        of its law would be confounded with that noise.
        """
        laws = _laws(self.rig, self.segments, self.rig_motion, trajectory, fine)
        return replace(self, laws=laws, trajectory=trajectory, fine=fine, chosen_law_columns=None)

    def with_law_error(self, law_error: float) -> "Problem":
        """The problem with the columns of law errors that are identifiable at a given size."""
        return replace(self, chosen_law_columns=self.law_columns.identifiable_at(law_error))

    def with_steps_for(self, effect: JointEffect) -> "Problem":
        """The problem with time steps short enough for an effect's fastest mode."""
        steps = substeps_for(self.segments.step, effect.fastest)
        return self if steps == 1 else replace(self, segments=self.segments.finer(steps))

    def in_steps(self, segments: Segments) -> Segments:
        """Other segments in the time steps of this problem."""
        return segments.finer(self.segments.substeps // segments.substeps)

    @cached_property
    def simulator(self) -> Simulator:
        """Of the rig."""
        return Simulator(self.rig, self.threads)

    @cached_property
    def law_columns(self) -> LawColumns:
        """Columns for errors of the nominal laws, in the identifiable shapes."""
        if self.chosen_law_columns is not None:
            return self.chosen_law_columns
        return law_columns(
            self.simulator, self.segments, self.trajectory, self.torque, self.laws, self.initial_noise
        )

    @cached_property
    def fitter(self) -> Fitter:
        """Of these segments."""
        return Fitter(
            self.simulator, self.segments, self.torque, NUISANCE, self.rig_motion, self.law_columns.W,
            self.drifts(self.segments),
        )  # fmt: skip

    def drifts(self, segments: Segments) -> Array:
        """(S, k) shapes of slow drift over the session, of unit mean square.

        Their mean over a session is not zero: what drifts is off by about two thirds of its variation.
        """
        own, shapes = _bumps(self.segments.order), _bumps(segments.order)
        several = np.sqrt(np.sum(np.var(own, axis=0))) > _NEGLIGIBLE
        return np.asarray(shapes / np.sqrt(np.sum(np.mean(own**2, axis=0))) if several else shapes[:, :0])

    @cached_property
    def quantities(self) -> tuple[str, ...]:
        """Quantity of each channel; places of bodies and angles of joints apart."""
        return tuple(o.quantity + (" of joint" if o.dof is not None else "") for o in self.rig.observations)

    @cached_property
    def catalogue(self) -> tuple[JointEffect, ...]:
        """Every effect on every part, and free forms."""
        return (*instances(self.rig_motion), *free_forms(self.rig_motion, self.segments))

    @property
    def memory_per_segment(self) -> int:
        """Bytes that derivatives by all candidates and errors of laws take, with their products."""
        columns = sum(len(effect.probe_values) for effect in self.catalogue) + sum(map(len, self.laws))
        L, dim = self.segments.shape[1], self.simulator.tangent.dim
        return 8 * columns * (L * dim + columns)

    @cached_property
    def initial_noise(self) -> Noise:
        """Initial noise."""
        nv = self.rig.model.nv
        speed = np.full(nv, max([j.speed for j in self.rig_motion.joints] + [self.rig_motion.speed, 1e-3]))
        for dofs in self._rotations:
            # Wide even where nothing travels.
            turning = np.sqrt(np.mean(np.sum(self.speed(self.trajectory)[..., dofs] ** 2, axis=-1)))
            speed[dofs] = np.maximum(speed[dofs], turning)
        observed = {observation.dof for observation in self.rig.observations}
        for joint in self.rig_motion.joints:
            if joint.v in observed:  # others are not observed
                speed[joint.v] = joint.speed
        unobserved = np.array([v not in observed for v in range(nv)])
        speed[unobserved] = np.minimum(speed, self._terminal_speed)[unobserved]
        dim = self.simulator.tangent.dim
        first = initial_noise(self.segments, self.torque, dim, self._position_spread, _SPEED_SPREAD * speed)
        clocks = [self.channels[observation.channel].clock for observation in self.rig.observations]
        first = replace(first, clock=np.unique(clocks, return_inverse=True)[1])
        return self.noise_on(self.segments, self.trajectory, first)

    @property
    def _rotations(self) -> list[slice]:
        """Degrees of freedom of the rotation of each ball joint and free body."""
        model, first = self.rig.model, {int(_BALL): 0, int(_FREE): 3}
        return [
            slice(int(model.jnt_dofadr[j]) + first[kind], int(model.jnt_dofadr[j]) + first[kind] + 3)
            for j, kind in enumerate(model.jnt_type.tolist())
            if kind in first
        ]

    @property
    def _position_spread(self) -> Array:
        """(nv,) sd of an initial position, which is wide where a joint is seen by its velocity alone."""
        spread = np.full(self.rig.model.nv, POSITION_SPREAD)
        seen = {(o.dof, o.quantity) for o in self.rig.observations}
        for joint in self.rig_motion.joints:
            if (joint.v, "velocity") in seen and (joint.v, "position") not in seen:
                spread[joint.v] = max(_UNKNOWN_ANGLE if joint.angle_unit == "rad" else 0.0, joint.travel)
        return spread

    @property
    def _terminal_speed(self) -> Array:
        """(nv,) at which damping holds the force on a joint; infinite where motion outlasts an interval.

        Simulations fix a base by giving it enormous damping: any speed that a first state could have there
        would be an enormous force.
        """
        model, inertia = self.rig.model, self.rig.model.dof_M0
        damping = np.maximum(model.dof_damping, 1e-300)
        lasts = inertia / damping > self.segments.interval
        return np.where(lasts, np.inf, self.torque / damping)

    def speed(self, trajectory: Array) -> Array:
        """(S, L, nv) of the degrees of freedom along a trajectory."""
        tangent = self.simulator.tangent
        return trajectory[..., tangent.nq : tangent.nq + tangent.nv]

    def frictional_speeds(self, hypothesis: Hypothesis, trajectory: Array) -> dict[str, Array]:
        """Joint -> (S, L) speed along a trajectory, of the joints with friction among the effects."""
        return {
            joint.name: self.speed(trajectory)[..., joint.v]
            for joint in self.rig_motion.joints
            if any(effect.friction and effect.part == joint.name for effect in hypothesis.effects)
        }

    def readings(self, segments: Segments, trajectory: Array) -> Array:
        """(S, L, ny) observations of the nominal model along a trajectory."""
        (S, L), u = segments.shape, segments.control()[:, :, :1]
        _, y, _ = self.simulator.run(
            self.rig.model, trajectory.reshape(S * L, -1), u.reshape(S * L, 1, u.shape[-1])
        )
        return y.reshape(S, L, -1)

    def rates(self, segments: Segments, trajectory: Array) -> Array:
        """(S, L, ny) time derivatives of the observations along a trajectory."""
        return segments.rate(self.readings(segments, trajectory))

    def noise_on(self, segments: Segments, trajectory: Array, noise: Noise) -> Noise:
        """A noise for segments along a trajectory, without outliers or pushes."""
        errors = control_errors(self.rig, segments, trajectory, self.torque)
        return noise.elsewhere(self.rates(segments, trajectory), segments.order, errors)

    def base(self, free: Sequence[JointEffect]) -> Hypothesis:
        """The nominal rig with its free parameters."""
        return Hypothesis(self.rig, tuple(free))


def _bumps(order: Array) -> Array:
    centres = np.arange(-0.5, 0.5 + _DRIFT_WIDTH / 2, _DRIFT_WIDTH)
    return np.asarray(np.exp(-0.5 * ((order[:, None] - centres) / _DRIFT_WIDTH) ** 2))


def _laws(
    rig: Rig, segments: Segments, scales: RigMotion, trajectory: Array, fine: bool = False
) -> tuple[Sequence[Perturbation], ...]:
    nq, nv = rig.model.nq, rig.model.nv
    following = np.concatenate([trajectory[:, 1:], trajectory[:, -1:]], axis=1)
    there, u = segments.inside, segments.control()
    x = trajectory[there]
    first = actuator_torque(rig.model, x, u[..., 0, :][there], rig.load)
    last = actuator_torque(rig.model, following[there], u[..., -1, :][there], rig.load)
    torque = (first + last) / 2
    order = np.repeat(segments.order[:, None], segments.shape[1], 1)[there]
    state = State(x[:, :nq], x[:, nq : nq + nv], torque, segments.time[there], order)
    return tuple(law_errors(scales, state, fine))


@dataclass(frozen=True)
class ScoredFit:
    """A fitted hypothesis with the scores of all missing candidates.

    Attributes:
        fit: of the hypothesis.
        system: linear about the trajectory before the last round of the fit.
        noise: of the data, with all candidates integrated out.
        residual_noise: noise including the process force that the hypothesis leaves, as used by the fit.
        eliminated: scores of the candidates, own parameters and nuisance eliminated.
        effects: candidates; `columns` holds their columns in the scores.
        columns: one index array for each effect.
        perturbations: one for each candidate column.
        pulses: scan for external pushes.
    """

    fit: Fit
    system: Linear
    noise: Noise
    residual_noise: Noise
    eliminated: Eliminated
    effects: tuple[JointEffect, ...]
    columns: tuple[NDArray[np.intp], ...]
    perturbations: tuple[Perturbation, ...]
    pulses: Scan

    @cached_property
    def gains(self) -> list[Gain]:
        """Gain of each candidate by itself.

        An error of the readings of incredible size has none: it is a multiple of the recorded motion, and
        would explain any motion that the model does not make.
        """
        found = gains(self.eliminated, self.columns)
        return [
            replace(gain, log_evidence=-np.inf) if is_incredible(effect, gain.values) else gain
            for effect, gain in zip(self.effects, found, strict=True)
        ]


def is_incredible(effect: JointEffect, values: Array) -> bool:
    """Whether an error of the readings has values, in standard deviations, that contradict its prior."""
    return effect.misreads and bool(np.any(np.abs(values) > CREDIBLE_SD))


def initial_fit(problem: Problem, hypothesis: Hypothesis) -> tuple[Problem, Fit, Noise]:
    """Fit a hypothesis from the recorded trajectory, with all unmodelled forces as process force.

    Returns:
        The problem with law errors along the fitted trajectory, the fit, and a first estimate of the noise.
    """
    trajectory = problem.trajectory
    fitter = Fitter(
        problem.simulator, problem.segments, problem.torque, NUISANCE, problem.rig_motion,
        drifts=problem.drifts(problem.segments),
    )  # fmt: skip
    system, prior = fitter.system(hypothesis, hypothesis.start, trajectory)
    noise = fit_noise(system, prior, problem.initial_noise, problem.segments, problem.quantities, last=False)
    fit = fitter.fit(hypothesis, hypothesis.start, trajectory, noise, rounds=8, known=system)
    return problem.along(fit.trajectory), fit, noise


@dataclass(frozen=True)
class Columns:
    """A linear system with columns of candidates.

    Attributes:
        system: linear about a trajectory.
        prior: of its columns.
        candidate: which of its columns are perturbations by candidates.
        perturbations: one for each of these.
    """

    system: Linear
    prior: Prior
    candidate: NDArray[np.bool_]
    perturbations: tuple[Perturbation, ...]

    def fitted(self, problem: Problem, noise: Noise, near: bool) -> "NoiseFit":
        """The noise with candidates integrated out, but for those that have many forms."""
        explains = ~self.candidate
        many = [p.effect is not None and _has_many(p.effect) for p in self.perturbations]
        explains[self.candidate] = ~np.array(many, bool)
        noise, explains = _fit_noise_with_columns(problem, self.system, self.prior, explains, noise, near)
        return NoiseFit(self, explains, noise)


@dataclass(frozen=True)
class NoiseFit:
    """Noise of the data with candidates integrated out.

    Attributes:
        columns: about a trajectory.
        explains: which of these were integrated out.
        noise: fitted.
    """

    columns: Columns
    explains: NDArray[np.bool_]
    noise: Noise

    @property
    def explaining(self) -> tuple[Linear, Prior]:
        """The system with the columns that were integrated out, and their priors."""
        used = self.explains
        return _select_columns(self.columns.system, used), self.columns.prior.select(used)


def _with_candidates(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    trajectory: Array,
    candidates: Sequence[JointEffect],
) -> Columns:
    perturbations = perturbations_of(candidates)
    system, prior = problem.fitter.system(hypothesis, theta, trajectory, perturbations)
    fixed = len(hypothesis.parameters) + len(NUISANCE)
    candidate = np.zeros(len(prior.sd), bool)
    candidate[fixed : fixed + len(perturbations)] = True
    return Columns(system, prior, candidate, tuple(perturbations))


def noise_with_candidates(
    problem: Problem, hypothesis: Hypothesis, theta: Array, trajectory: Array, noise: Noise
) -> NoiseFit:
    """Noise about a trajectory with everything that may be missing integrated out.

    Args:
        problem: data.
        hypothesis: a model.
        theta: its values.
        trajectory: (S, L, nx).
        noise: initial noise.
    """
    candidates = candidates_for(problem, hypothesis)
    columns = _with_candidates(problem, hypothesis, theta, trajectory, candidates)
    return columns.fitted(problem, noise, near=False)


def noise_without_followed(
    problem: Problem, hypothesis: Hypothesis, theta: Array, trajectory: Array, noise: Noise
) -> tuple[Problem, Array, NoiseFit]:
    """Fit the noise about a trajectory that does not follow the noise of the readings.

    A process force that stands in for a missing effect lets a trajectory follow noise that lasts. Forces of
    the model along it, and so columns of candidates and of errors of laws, contain that noise then and
    explain it, so that noise would come out too small. What candidates leave of the process force does not
    follow it: trajectory and noise are fitted in turn. Noise that does not last averages out anyway.

    Args:
        problem: data.
        hypothesis: a model.
        theta: its values.
        trajectory: where to begin.
        noise: initial noise.

    Returns:
        The problem with errors of laws along the trajectory, the trajectory, and the noise about it.
    """
    lasts = False
    for last in (*[False] * _SMOOTHER_ROUNDS, True):
        found = noise_with_candidates(problem, hypothesis, theta, trajectory, noise)
        columns = found.columns
        lasts = lasts or bool(found.noise.coloured.any())
        delta = _change(problem, columns, found.explains, found.noise) if lasts and not last else None
        if delta is None:
            break
        trajectory, noise = problem.simulator.tangent.add(trajectory, delta), found.noise
        problem = problem.along(trajectory)
    return problem, trajectory, found


def _change(problem: Problem, columns: Columns, explains: NDArray[np.bool_], noise: Noise) -> Array | None:
    """(S, L, n) of a trajectory to that with the process force that candidates leave; None where it is near.

    Candidates that misread are left out: a trajectory would go far from the readings, as these explain it.
    """
    misread = columns.candidate & columns.system.psi.any(axis=(0, 1, 2))
    used = explains & ~misread
    system, covariances = _select_columns(columns.system, used), noise.covariances(problem.segments.interval)
    values = posterior_means(innovations(system, covariances), columns.prior.select(used).at(noise))
    delta, *_ = smooth(system.moved(values).without_columns(), covariances)
    change = np.einsum("stcn,stn->stc", system.C, delta) / noise.single
    return delta if np.sqrt(np.mean(change[np.isfinite(system.r)] ** 2)) > _FOLLOWED else None


@dataclass(frozen=True)
class FitWithNoise:
    """A hypothesis fitted under noise of its own.

    Attributes:
        fit: of the hypothesis.
        noise: of the data, with candidates integrated out.
        residual_noise: noise including the process force that the hypothesis leaves, as used by the fit.
        columns: about the trajectory before the last round of the fit.
    """

    fit: Fit
    noise: Noise
    residual_noise: Noise
    columns: Columns


def fit_with_noise(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    trajectory: Array,
    noise: Noise,
    *,
    near: bool = True,
    may_set_aside: bool = False,
    candidates: Sequence[JointEffect] | None = None,
    known: NoiseFit | None = None,
) -> FitWithNoise:
    """Fit a hypothesis and its noise; what candidates could explain is not counted as noise.

    Args:
        problem: data.
        hypothesis: what to fit.
        theta: first values.
        trajectory: first trajectory.
        noise: initial noise.
        near: whether the noise was fitted before, so that one initial point suffices.
        may_set_aside: whether a few windows may be set aside.
        candidates: that the system has columns of; None for those that tell the noise.
        known: the noise about the first trajectory, if it is known.
    """
    if known is None:
        if candidates is None:
            candidates = [effect for effect in candidates_for(problem, hypothesis) if not _has_many(effect)]
        pushed = push_error(_pushes(hypothesis, theta), noise.torque, problem.segments, problem.rig_motion)
        columns = _with_candidates(problem, hypothesis, theta, trajectory, candidates)
        known = columns.fitted(problem, replace(noise, push_error=pushed), near)
    fitter, interval = problem.fitter, problem.segments.interval
    columns, noise, explains = known.columns, known.noise, known.explains
    system, prior, candidate = columns.system, columns.prior, columns.candidate
    if may_set_aside:
        before = noise
        noise = _with_set_aside(problem, system, prior, explains, problem.speed(trajectory), before)
        if noise.set_aside is not None or before.set_aside is not None:
            noise, _ = _fit_noise_with_columns(problem, system, prior, explains, noise, near=True)
    own, of_own = _select_columns(system, ~candidate), prior.select(~candidate)
    left = fit_process_force(own, of_own, noise, interval, largest_law_error(noise))
    fit = fitter.fit(hypothesis, theta, trajectory, left, rounds=8, known=system, patient=True)
    fit = _with_mean_forces(problem, fit, left)
    return FitWithNoise(fit, noise, left, columns)


def fit_and_score(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    trajectory: Array,
    noise: Noise,
    *,
    near: bool = True,
    may_set_aside: bool = False,
    known: NoiseFit | None = None,
) -> tuple[ScoredFit, Scores]:
    """Fit a hypothesis and its noise, and score all missing candidates.

    All segments' scores, which a test needs, are far larger than everything else and are not kept.

    Args:
        problem: data.
        hypothesis: what to fit.
        theta: first values.
        trajectory: first trajectory.
        noise: initial noise.
        near: whether the noise was fitted before, so that one initial point suffices.
        may_set_aside: whether a few windows may be set aside.
        known: the noise about the first trajectory, if it is known.
    """
    effects = candidates_for(problem, hypothesis)
    found = fit_with_noise(
        problem, hypothesis, theta, trajectory, noise,
        near=near, may_set_aside=may_set_aside, candidates=effects, known=known,
    )  # fmt: skip
    # About the trajectory before the last fit, which is equally valid: scores eliminate the fitted
    # parameters.
    columns, noise = found.columns, found.noise
    system, fixed = columns.system, ~columns.candidate
    seen = innovations(system, noise.covariances(problem.segments.interval))
    sd = columns.prior.at(noise)
    z = seen.Z[..., fixed].reshape(seen.e.size, -1) * sd[fixed]
    values = sd[fixed] * np.linalg.solve(np.eye(z.shape[1]) + z.T @ z, z.T @ seen.e.reshape(-1))
    named = [pulse for effect, _ in _pushes(hypothesis, theta) for pulse in effect.pulses]
    pulses = scan(
        _select_columns(system, fixed), values, noise, problem.segments, problem.rig_motion, named,
        problem.frictional_speeds(hypothesis, trajectory),
    )  # fmt: skip
    of_effect = tuple(
        np.array([i for i, perturbation in enumerate(columns.perturbations) if perturbation.effect is effect])
        for effect in effects
    )
    of = scores(seen, sd, fixed)
    eliminated = replace(Elimination(of)(of.b), by_segment=None)
    scored = ScoredFit(
        found.fit, system.without_columns(), noise, found.residual_noise, eliminated, effects, of_effect,
        columns.perturbations, pulses,
    )  # fmt: skip
    return scored, of


def scored_under(problem: Problem, fit: Fit, noise: Noise) -> tuple[ScoredFit, Scores]:
    """The same about the trajectory of a fit, under a noise that is not fitted."""
    of = problem, fit.hypothesis, fit.theta, fit.trajectory
    columns = _with_candidates(*of, candidates_for(problem, fit.hypothesis))
    return fit_and_score(*of, noise, known=NoiseFit(columns, ~columns.candidate, noise))


def candidates_for(problem: Problem, hypothesis: Hypothesis) -> tuple[JointEffect, ...]:
    """Effects of the catalogue that a hypothesis does not have."""
    present = {effect.key for effect in hypothesis.effects}
    return tuple(e for e in problem.catalogue if e.probe_values and e.key not in present)


def largest_law_error(noise: Noise) -> float:
    """How much laws may err in fits under a noise that was fitted with candidates integrated out.

    Not much more than beside these, or than is typical: larger errors would stand in for a missing effect.
    """
    return min(LARGEST_LAW_ERROR, max(_LAW_ERROR_MARGIN * noise.law_error, TYPICAL_LAW_ERROR))


def _has_many(effect: JointEffect) -> bool:
    """Whether an effect has so many forms that these would explain the noise."""
    return effect.many_forms or is_free(effect)


def _pushes(hypothesis: Hypothesis, theta: Array) -> list[tuple[ExternalPulse, Array]]:
    """Named pushes with their values."""
    named = zip(hypothesis.effects, hypothesis.slices, strict=True)
    return [(effect, theta[own]) for effect, own in named if isinstance(effect, ExternalPulse)]


def _with_mean_forces(problem: Problem, fit: Fit, noise: Noise) -> Fit:
    """The fit with pushes of their mean force, as if they were constant.

    Where their shape may differ, a part of them counts as an error of it. All other values stay, and so do
    standard deviations, which hold that error.
    """
    if noise.push_error is None:
        return fit
    hypothesis, p = fit.hypothesis, len(fit.theta)
    of_push = np.zeros(p, bool)
    for effect, own in zip(hypothesis.effects, hypothesis.slices, strict=True):
        of_push[own] = isinstance(effect, ExternalPulse)
    system, prior = problem.fitter.system(hypothesis, fit.theta, fit.trajectory)
    columns = np.concatenate([of_push, np.zeros(len(prior.sd) - p, bool)])
    constant = replace(noise, push_error=None).covariances(problem.segments.interval)
    found = innovations(_select_columns(system, columns), constant)
    z, weight = found.Z.reshape(found.e.size, -1), hypothesis.prior_sd[of_push] ** -2.0
    information = z.T @ z + np.diag(weight)
    gradient = z.T @ found.e.reshape(-1) - weight * (fit.theta - hypothesis.start)[of_push]
    theta = fit.theta.copy()
    theta[of_push] += np.linalg.solve(information, gradient)
    return replace(fit, theta=theta)


def _with_set_aside(
    problem: Problem, system: Linear, prior: Prior, explains: NDArray[np.bool_], speed: Array, noise: Noise
) -> Noise:
    """Noise with further process force in the windows of a few enormous pushes, which no column explains.

    They must be worth their windows, each of which could have been any. Those that were set aside before,
    under other columns, stay if they still are.
    """
    segments, none = problem.segments, noise.without_set_aside
    used, own = _select_columns(system, explains), prior.select(explains)

    def level(found: Noise) -> tuple[float, Noise, Innovations]:
        """Log likelihood under the process force that is left."""
        whole = fit_process_force(used, own, found, segments.interval)
        seen = innovations(used, whole.covariances(segments.interval))
        return marginal_likelihood(seen, own.at(whole)), whole, seen

    first, whole, seen = level(none)
    if noise.set_aside is not None and level(noise)[0] - first > least_worth(noise.set_aside, segments):
        return noise
    last, found = first, none
    for _ in range(SET_ASIDE_ROUNDS):
        values = posterior_means(seen, own.at(whole))
        windows = windows_set_aside(used, values, speed, whole, segments, problem.rig_motion)
        before = found.set_aside
        if windows is None or (before is not None and np.array_equal(windows > 0, before > 0)):
            break  # none, too many as each makes the others' spread smaller, or the same
        found = replace(found, set_aside=windows)
        last, whole, seen = level(found)
    return found if last - first > least_worth(found.set_aside, segments) else none


def _fit_noise_with_columns(
    problem: Problem, system: Linear, prior: Prior, explains: NDArray[np.bool_], noise: Noise, near: bool
) -> tuple[Noise, NDArray[np.bool_]]:
    """Noise with some columns integrated out, except those whose values would be incredible; and which."""

    def fit(noise: Noise, near: bool) -> Noise:
        used, own = _select_columns(system, explains), prior.select(explains)
        return fit_noise(used, own, noise, problem.segments, problem.quantities, near=near)

    for again in (False, True):
        # Anew from the initial values: with incredible columns, noise without any size fits best.
        fitted, before = fit(noise, near), noise
        for _ in range(_OUTLIER_ROUNDS):
            # Noise was fitted with outliers that had not been down-weighted.
            if np.mean(np.abs(np.log(fitted.outlying / before.outlying))) < _SAME_WEIGHTS:
                break
            fitted, before = fit(fitted, near=True), fitted
        credible = _credible(explains, system, prior, fitted, problem.segments)
        if again or np.array_equal(credible, explains):
            break
        explains = credible
    return fitted, explains


def _credible(
    explains: NDArray[np.bool_], system: Linear, prior: Prior, noise: Noise, segments: Segments
) -> NDArray[np.bool_]:
    """Those of some columns whose values are credible where they explain the data under a noise.

    A column of the readings, such as an encoder's scale, is a multiple of the recorded motion itself. Where
    the model lacks most of the forces, a scale near -1 would explain the readings with their noise.
    """
    used, sd = _select_columns(system, explains), prior.select(explains).at(noise)
    values = posterior_means(innovations(used, noise.covariances(segments.interval)), sd)
    incredible = (np.abs(values) > CREDIBLE_SD * sd) & used.psi.any(axis=(0, 1, 2))
    credible = explains.copy()
    credible[np.flatnonzero(explains)[incredible]] = False
    return credible


def _select_columns(system: Linear, columns: NDArray[np.bool_]) -> Linear:
    return system.with_columns(
        np.ascontiguousarray(system.W[..., columns]), np.ascontiguousarray(system.psi[..., columns])
    )
