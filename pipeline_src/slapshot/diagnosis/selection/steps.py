"""Steps of the search for missing effects: hypotheses, fitted, scored and tested, and refits of the next."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import innovations
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.fit.noise import TYPICAL_LAW_ERROR, Noise, fit_process_force
from slapshot.diagnosis.inference.mismatch_test import (
    DRAWS,
    MismatchTest,
    Scores,
    mismatch_test,
    overdispersion,
    scores,
)
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.selection.dry_friction import with_one_level
from slapshot.diagnosis.selection.problem import (
    NoiseFit,
    Problem,
    ScoredFit,
    fit_and_score,
    fit_with_noise,
    initial_fit,
    largest_law_error,
    noise_without_followed,
    scored_under,
)
from slapshot.effects.joints.effect import JointEffect

P_VALUE = 0.01
# Behind the best candidate, beyond which none is refitted to all data: share of its gain, or nats.
REFIT_MARGIN, REFIT_MARGIN_NATS = 0.02, 30.0
EQUIVALENCE_NATS = float(np.log(20.0))  # rivals within a factor of twenty are equivalent
_LARGE_LAW_ERROR = 0.01  # law errors above which all shapes are used
_MARGIN = 2.0  # factor on the fitted law error when columns are chosen
_SECOND_ROUNDS = 4  # rounds under the refitted process force
_DISTANT_NATS = 100.0  # gain beyond which a fit and its noise are repeated from where they arrived

Report = Callable[[str], None]


@dataclass(frozen=True)
class Rival:
    """An effect that was refitted in a step, and its gain in nats."""

    effect: JointEffect
    gain: float
    fit: Fit

    @property
    def has_no_effect(self) -> bool:
        """Whether the fitted effect is zero."""
        return has_no_effect(self.effect, self.fit)


def has_no_effect(effect: JointEffect, fit: Fit) -> bool:
    """Whether the last effect of a fit is none by its values, such as a size of 0."""
    return not effect.describes(fit.theta[len(fit.theta) - len(effect.parameters) :])


@dataclass(frozen=True)
class Step:
    """One step of the search.

    Attributes:
        problem: possibly restructured.
        scored: hypothesis at the end of the step, with scores.
        test: mismatch test of it.
        added: effect that was added; None at first.
        gain: its gain in nats.
        rivals: refitted in this step, best first.
    """

    problem: Problem
    scored: ScoredFit
    test: MismatchTest
    added: JointEffect | None = None
    gain: float = 0.0
    rivals: tuple[Rival, ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis of this step."""
        return self.scored.fit.hypothesis


@dataclass(frozen=True)
class Search:
    """All steps; the first is the nominal rig with its free parameters.

    Attributes:
        steps: in turn.
        free: effects of the nominal rig itself.
        by_laws: steps that would have been taken but for a model with hidden states, which explains more of
            what was fitted; none where no such model was taken.
        by_structure: steps that end with a model with hidden states which explains nearly as much as the laws
            that were taken; none where it explains far less, or was taken itself.
        dropped: effects that were added, but do not predict held-out windows better.
    """

    steps: tuple[Step, ...]
    free: tuple[JointEffect, ...]
    by_laws: tuple[Step, ...] = ()
    by_structure: tuple[Step, ...] = ()
    dropped: tuple[JointEffect, ...] = ()

    @property
    def nominal(self) -> Step:
        """The first."""
        return self.steps[0]

    @property
    def final(self) -> Step:
        """The last."""
        return self.steps[-1]

    @property
    def named(self) -> tuple[JointEffect, ...]:
        """Effects that were added and kept."""
        free = {effect.key for effect in self.free}
        return tuple(e for e in self.final.hypothesis.effects if e.key not in free)

    def before(self, effect: JointEffect | None) -> "Search":
        """The search before an effect was added."""
        return replace(self, steps=self.steps[: self.first_with(None if effect is None else effect.key)])

    def first_with(self, key: str | None) -> int:
        """Number of the step that added an effect, or in which it came of others; that of all if none.

        By its key: what it shares with others may have become theirs.
        """
        for number, step in enumerate(self.steps[1:], 1):
            present = [effect.key for effect in step.hypothesis.effects]
            if key in present or (step.added is not None and step.added.key == key):
                return number
        return len(self.steps)

    def since(self, effect: JointEffect | None) -> list[JointEffect]:
        """An effect and those that were added after it."""
        later = self.steps[len(self.before(effect).steps) :]
        return list({step.added.key: step.added for step in later if step.added is not None}.values())


@dataclass(frozen=True)
class NominalMotion:
    """The nominal rig with a trajectory that does not follow noise, before it is fitted and tested.

    Attributes:
        problem: with errors of laws along the trajectory.
        hypothesis: the rig with its free parameters.
        theta: their values.
        trajectory: (S, L, nx).
        known: the noise about it.
    """

    problem: Problem
    hypothesis: Hypothesis
    theta: Array
    trajectory: Array
    known: NoiseFit


def nominal_motion(problem: Problem, free: Sequence[JointEffect]) -> NominalMotion:
    """Motion and noise of the nominal rig, whatever windows are set aside later."""
    base = problem.base(free)
    problem, fit, noise = initial_fit(problem, base)
    problem, trajectory, known = noise_without_followed(problem, base, fit.theta, fit.trajectory, noise)
    return NominalMotion(problem, base, fit.theta, trajectory, known)


def nominal_step(motion: NominalMotion, rng: np.random.Generator, may_set_aside: bool = True) -> Step:
    """The nominal rig with its free parameters, fitted and tested."""
    problem, base, trajectory, known = motion.problem, motion.hypothesis, motion.trajectory, motion.known
    scored, of = fit_and_score(
        problem, base, motion.theta, trajectory, known.noise, may_set_aside=may_set_aside, known=known
    )
    if scored.noise.law_error <= _LARGE_LAW_ERROR:
        return Step(problem, scored, mismatch_and_push_test(scored, of, rng))
    fine = problem.along(trajectory, fine=True)
    # With few shapes, errors of laws at speeds and loads that are rare look like pushes.
    scored, of = fit_and_score(
        fine, base, scored.fit.theta, trajectory, scored.noise, may_set_aside=may_set_aside
    )
    step = Step(fine, scored, mismatch_and_push_test(scored, of, rng))
    if step.test.p_value >= P_VALUE:
        return step
    # Refits with all shapes are slow: from here only the identifiable ones are used.
    law_error = scored.noise.law_error
    return _refitted_to(
        step, problem if law_error <= _LARGE_LAW_ERROR else fine.with_law_error(_MARGIN * law_error)
    )


def _refitted_to(step: Step, problem: Problem) -> Step:
    """The step refitted to a problem with other columns of law errors."""
    fit, left, interval = step.scored.fit, step.scored.residual_noise, problem.segments.interval
    system, prior = problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    left = fit_process_force(system, prior, left, interval, largest_law_error(step.scored.noise))
    fit = problem.fitter.fit(fit.hypothesis, fit.theta, fit.trajectory, left, known=system, patient=True)
    return replace(step, problem=problem, scored=replace(step.scored, fit=fit, residual_noise=left))


LEAST_P_VALUE = 1 - (1 - 1 / (DRAWS + 1)) ** 2  # that draws can give


def mismatch_and_push_test(scored: ScoredFit, of: Scores, rng: np.random.Generator) -> MismatchTest:
    """Test of all groups of columns and of pushes; both p-values are combined (Šidák)."""
    found = mismatch_test(of, scored.columns, rng)
    pushed = scored.pulses.p_value(rng, DRAWS)
    return replace(found, p_value=1 - (1 - min(found.p_value, pushed)) ** 2, push_p_value=pushed)


def with_typical_errors(noise: Noise, hypothesis: Hypothesis) -> Noise:
    """The noise with errors of laws that a hypothesis adds at least as large as is typical of such laws.

    The same where it adds no empirical law: what a few per cent of a named law explain is nothing unknown.
    """
    if not any(effect.empirical for effect in hypothesis.added):
        return noise
    return replace(noise, added_error=max(noise.added_error, TYPICAL_LAW_ERROR))


def beside_law_errors(step: Step, rng: np.random.Generator) -> Step:
    """The step tested with errors of the laws that it added, at least as large as is typical of such laws.

    Errors of these are fitted with candidates integrated out, among them forces of unknown shape, which
    explain what an error in shape leaves. What a few per cent of a named law explain is nothing unknown.
    The same step where it added no empirical law, their errors are as large already, or a refit diverges.
    """
    scored, fit = step.scored, step.scored.fit
    allowed = with_typical_errors(scored.noise, step.hypothesis)
    if allowed.added_error == scored.noise.added_error:
        return step
    try:
        scored, of = scored_under(step.problem, fit, allowed)
    except np.linalg.LinAlgError:
        return step
    return replace(step, scored=scored, test=mismatch_and_push_test(scored, of, rng))


def least_gain(scored: ScoredFit) -> float:
    """Nats that an effect must gain to be added: one of many candidates, within a factor of twenty."""
    return float(np.log(len(scored.effects))) + EQUIVALENCE_NATS


def refit(step: Step, effect: JointEffect, start: Array, rounds: int = 8) -> Fit:
    """Refit the step's hypothesis with one more effect, under its own process force.

    The first fit uses the process force without the effect, which absorbs part of it.

    Args:
        step: what is known.
        effect: to add.
        start: its first values.
        rounds: of the first fit.
    """
    scored, fitter = step.scored, step.problem.fitter
    hypothesis = scored.fit.hypothesis.with_effect(effect)
    theta = np.concatenate([scored.fit.theta, start])
    fit = fitter.fit(
        hypothesis, theta, scored.fit.trajectory, scored.residual_noise, rounds, known=scored.system
    )
    if not np.isfinite(fit.log_evidence) or has_no_effect(effect, fit):
        return fit
    system, prior = fitter.system(hypothesis, fit.theta, fit.trajectory)
    largest = largest_law_error(scored.noise)
    own = fit_process_force(system, prior, scored.residual_noise, step.problem.segments.interval, largest)
    again = fitter.fit(hypothesis, fit.theta, fit.trajectory, own, _SECOND_ROUNDS, known=system)
    return again if again.log_evidence > fit.log_evidence else fit


def rival_overdispersion(step: Step, rival: Rival, count: int = 1) -> float:
    """Overdispersion of the last effects' scores between segments, relative to the noise; at least 1.

    Unmodelled forces are persistent and not white, so that log evidence is overestimated by this factor (the
    information over the scores' variance, as in Godambe 1960, Annals of Mathematical Statistics 31(4)).

    Args:
        step: before.
        rival: fit of the step's hypothesis with further effects.
        count: of these.
    """
    left, fitter, fit = step.scored.residual_noise, step.problem.fitter, rival.fit
    system, prior = fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    found = innovations(system, left.covariances(step.problem.segments.interval))
    known = np.ones(len(prior.sd), bool)
    for own in fit.hypothesis.slices[-count:]:
        known[own] = False
    return overdispersion(scores(found, prior.at(left), known), step.problem.segments.blocks())


def one_step_values(scored: ScoredFit, index: int, values: Array) -> Array:
    """One-step estimate of an effect's values from its columns, clipped to bounds."""
    effect = scored.effects[index]
    start = np.array([parameter.start for parameter in effect.parameters])
    perturbations = [scored.perturbations[c] for c in scored.columns[index]]
    moved = start.copy()
    best = -np.inf
    for perturbation, value in zip(perturbations, values, strict=True):
        which = int(np.argmax(np.abs(np.array(perturbation.values) - start)))
        if len(perturbations) <= len(start):
            moved[which] = start[which] + value * perturbation.scale
        elif abs(value) > best:  # several perturbations of one parameter: the largest one
            best = abs(value)
            moved[which] = perturbation.values[which]
    low = [parameter.low for parameter in effect.parameters]
    high = [parameter.high for parameter in effect.parameters]
    return np.clip(moved, low, high)


def step_to(
    step: Step,
    fit: Fit,
    effect: JointEffect,
    gain: float,
    rivals: Sequence[Rival],
    rng: np.random.Generator,
) -> Step:
    """The step that adds an effect, from a fit with it."""
    noise, first = step.scored.noise, None
    hypothesis, theta = with_one_level(fit.hypothesis, fit.theta)
    same = [present for present in hypothesis.effects if present.key == effect.key]
    # Together with others it may have become another one.
    before = {present.key for present in fit.hypothesis.effects}
    became = [present for present in hypothesis.effects if present.key not in before]
    added = next(iter(same + became), effect)
    rivals = [replace(rival, effect=added) if rival.effect is effect else rival for rival in rivals]
    rivals = [rival for rival in rivals if rival.effect is added or rival.effect.key != added.key]
    if fit.log_evidence > step.scored.fit.log_evidence + _DISTANT_NATS:
        # The noise was that of a model which explains far less, and so was the trajectory.
        first = fit_with_noise(step.problem, hypothesis, theta, fit.trajectory, noise)
        fit, noise, theta = first.fit, first.noise, first.fit.theta
    near = first is None
    scored, of = fit_and_score(step.problem, hypothesis, theta, fit.trajectory, noise, near=near)
    if first is not None and scored.fit.log_evidence < fit.log_evidence:
        # With other process force and law errors it went to a lower optimum; scores are about the first one.
        scored = replace(scored, fit=fit, residual_noise=first.residual_noise)
    return Step(step.problem, scored, mismatch_and_push_test(scored, of, rng), added, gain, tuple(rivals))
