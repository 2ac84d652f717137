"""Forward search for missing effects: added one at a time, by refits, until nothing is significant.

Columns screen, refits decide. Where no stateless law explains the residual, models with hidden states are
fitted (elasticity or backlash of a joint), by shooting. Free forms are never named: where one explains what
named effects do not, an effect outside the catalogue is missing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.filter import innovations
from slapshot.diagnosis.fit import Fit
from slapshot.diagnosis.free_forms import is_free
from slapshot.diagnosis.hypothesis import Hypothesis
from slapshot.diagnosis.inference.mismatch_test import (
    DRAWS,
    MismatchTest,
    mismatch_test,
    overdispersion,
    scores,
)
from slapshot.diagnosis.law_error import LOW_SPEED
from slapshot.diagnosis.noise import LARGEST_LAW_ERROR, Noise, fit_noise, fit_process_force
from slapshot.diagnosis.problem import Problem, ScoredFit, fit_and_score, initial_fit
from slapshot.diagnosis.pulses import pushes
from slapshot.diagnosis.shooting import shoot, simulate
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.external_pulse import ExternalPulse

P_VALUE = 0.01
MAX_EFFECTS = 5
_LARGE_LAW_ERROR = 0.01  # law errors above which all shapes are used
_MARGIN = 2.0  # factor on the fitted law error when columns are chosen
MAX_REFITS = 6  # candidates refitted in a step
_PRESELECTION_NODES, _PRESELECTION_ROUNDS = 2000, 4  # of a preliminary refit
_SECOND_ROUNDS = 4  # rounds under the refitted process force
_REFIT_MARGIN, _REFIT_MARGIN_NATS = (
    0.02,
    30.0,
)  # margins behind the best candidate, beyond which none is refitted to all data
EQUIVALENCE_NATS = float(np.log(20.0))  # rivals within a factor of twenty are equivalent
_STRUCTURE_JOINTS = 3
_STRUCTURE_STEPS = 2  # steps in which structures are fitted: alone, and besides the best law
_STRUCTURE_ROUNDS, _STRUCTURE_SEGMENTS = 6, 12  # for a preliminary fit of structures
_SPREAD, _LEAST_SPREAD = (
    3.0,
    1e-8,
)  # prior sd of a hidden initial state, in rms of its motion; minimum share of its variance
_STRUCTURE_MARGIN = 20.0  # nats behind the best law, beyond which a structure is dropped

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
    """Whether the last effect of a fit is zero: all its non-negative sizes are 0."""
    own = fit.theta[len(fit.theta) - len(effect.parameters) :]
    sizes = [(value, p) for value, p in zip(own, effect.parameters, strict=True) if p.low == p.start == 0]
    return bool(sizes) and all(value <= 1e-9 * p.scale for value, p in sizes)


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
    """All steps; the first is the nominal rig with its free parameters."""

    steps: tuple[Step, ...]
    free: tuple[JointEffect, ...]

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
        since = next((i for i, step in enumerate(self.steps) if step.added is effect), len(self.steps))
        return replace(self, steps=self.steps[:since])

    def since(self, effect: JointEffect | None) -> list[str]:
        """Keys of an effect and of those that were added after it."""
        later = self.steps[len(self.before(effect).steps) :]
        return list(dict.fromkeys(step.added.key for step in later if step.added is not None))


def search(problem: Problem, free: Sequence[JointEffect], seed: int, report: Report) -> Search:
    """Search for missing effects.

    Args:
        problem: segments that may be used.
        free: effects of the nominal rig itself.
        seed: of the draws behind p-values.
        report: receives progress messages.
    """
    rng = np.random.default_rng(seed)
    report("fitting the nominal model")
    steps = [nominal_step(problem, free, rng)]
    if not steps[0].scored.fit.settled:
        return Search(tuple(steps), tuple(free))
    while steps[-1].test.p_value < P_VALUE and len(steps) <= MAX_EFFECTS:
        try:
            before = steps[-1]
            step = _forward_step(before, rng, report)
            law = before if step is None else step
            split = any(effect.hidden_state for effect in before.hypothesis.effects)
            if len(steps) <= _STRUCTURE_STEPS and not split and _much_is_left(law):
                step = _structural_step(before, law, rng, report) or step
            if step is None:
                break
            steps.append(step)
        except np.linalg.LinAlgError:
            # The effects found so far are kept, and their test remains significant.
            report("a refit diverges: the search ends")
            break
    final = _backward_elimination(steps[-1], free, rng, report)
    if final is not steps[-1]:
        steps.append(final)
    return Search(tuple(steps), tuple(free))


def _much_is_left(step: Step) -> bool:
    """Whether a candidate, such as a free form, would still explain something."""
    largest = max((gain.log_evidence for gain in step.scored.gains), default=0.0)
    return step.test.p_value < P_VALUE and largest > _threshold(step.scored)


def _threshold(scored: ScoredFit) -> float:
    """Nats that an effect must gain to be added: one of many candidates, within a factor of twenty."""
    return float(np.log(len(scored.effects))) + EQUIVALENCE_NATS


def nominal_step(problem: Problem, free: Sequence[JointEffect], rng: np.random.Generator) -> Step:
    """The nominal rig with its free parameters, fitted and tested."""
    base = problem.base(free)
    problem, fit, noise = initial_fit(problem, base)
    scored = fit_and_score(problem, base, fit.theta, fit.trajectory, noise, near=False)
    if scored.noise.law_error <= _LARGE_LAW_ERROR:
        return Step(problem, scored, _test(scored, rng))
    fine = problem.along(scored.fit.trajectory, fine=True)
    scored = fit_and_score(fine, base, scored.fit.theta, scored.fit.trajectory, scored.noise)
    step = Step(fine, scored, _test(scored, rng))
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
    left = fit_process_force(system, prior, left, interval)
    fit = problem.fitter.fit(fit.hypothesis, fit.theta, fit.trajectory, left, known=system)
    return replace(step, problem=problem, scored=replace(step.scored, fit=fit, residual_noise=left))


def _test(scored: ScoredFit, rng: np.random.Generator) -> MismatchTest:
    """Test of all groups of columns and of pushes; both p-values are combined (Šidák)."""
    found = mismatch_test(scored.scores, scored.columns, rng)
    pushed = scored.pulses.p_value(rng, DRAWS)
    return replace(found, p_value=1 - (1 - min(found.p_value, pushed)) ** 2, push_p_value=pushed)


def _forward_step(step: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """Add the effect with the largest gain; None if none gains enough."""
    scored, problem = step.scored, step.problem
    threshold = _threshold(scored)
    found = scored.gains
    order = sorted(range(len(found)), key=lambda i: -found[i].log_evidence)
    rivals: list[Rival] = []
    candidates: dict[str, tuple[JointEffect, Array]] = {}
    for i in order:
        effect = scored.effects[i]
        # One initial period is enough for each joint.
        family = f"{effect.name}@{effect.part}{effect.variant}"
        if not is_free(effect) and family not in candidates and found[i].log_evidence >= min(threshold, 3.0):
            candidates[family] = effect, one_step_values(scored, i, found[i].values)
        if len(candidates) == MAX_REFITS:
            break
    leader = -np.inf
    for effect, start, gain in _preselect(step, list(candidates.values())):
        if gain < leader - max(_REFIT_MARGIN_NATS, _REFIT_MARGIN * leader):
            break
        fit = refit(step, effect, start)
        rival = Rival(effect, fit.log_evidence - scored.fit.log_evidence, fit)
        report(
            f"refitted {effect.key}: {rival.gain:+.1f} nats{', at no size' if rival.has_no_effect else ''}"
        )
        if not rival.has_no_effect:
            leader = max(leader, gain)
            rivals.append(rival)
    leader = max((rival.gain for rival in rivals), default=0.0)
    present = {effect.key for effect in step.hypothesis.effects}
    if step.test.push_p_value < P_VALUE:
        for push, promise in pushes(scored.pulses, problem.segments, problem.rig_motion):
            if push.key not in present and promise > _REFIT_MARGIN * leader:
                fit = refit(step, push, np.zeros(len(push.parameters)))
                rivals.append(Rival(push, fit.log_evidence - scored.fit.log_evidence, fit))
                report(f"refitted {push.name}@{push.part}: {rivals[-1].gain:+.1f} nats")
    rivals.sort(key=lambda rival: -rival.gain)
    if not rivals or rivals[0].gain < threshold:
        return None
    best = _simplest(step, rivals)
    if not isinstance(best.effect, ExternalPulse) and best.gain < threshold * _overdispersion(step, best):
        report(f"not added: {best.effect.key}, on which segments disagree too much")
        return None
    scored = fit_and_score(
        problem, best.fit.hypothesis, best.fit.theta, best.fit.trajectory, step.scored.noise
    )
    return Step(problem, scored, _test(scored, rng), best.effect, best.gain, tuple(rivals))


def _overdispersion(step: Step, rival: Rival) -> float:
    """Overdispersion of an effect's scores between segments, relative to the noise; at least 1.

    Unmodelled forces are persistent and not white, so that log evidence is overestimated by this factor (the
    information over the scores' variance, as in Godambe 1960, Annals of Mathematical Statistics 31(4)).
    """
    left, fitter, fit = step.scored.residual_noise, step.problem.fitter, rival.fit
    system, prior = fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    found = innovations(system, left.covariances(step.problem.segments.interval))
    known = np.ones(len(prior.sd), bool)
    known[fit.hypothesis.slices[-1]] = False
    return overdispersion(scores(found, prior.at(left), known))


def _preselect(
    step: Step, candidates: Sequence[tuple[JointEffect, Array]]
) -> list[tuple[JointEffect, Array, float]]:
    """Candidates fitted to a subset of segments, best first: values and approximate gain for all segments."""
    scored, problem = step.scored, step.problem
    S, L = problem.segments.shape
    some = np.unique(np.linspace(0, S - 1, min(S, max(4, _PRESELECTION_NODES // L))).astype(int))
    fitter = problem.fitter.select(some)
    noise = scored.residual_noise.select(some)
    system, trajectory = scored.system.select(some), scored.fit.trajectory[some]
    base, theta = scored.fit.hypothesis, scored.fit.theta
    none = fitter.fit(base, theta, trajectory, noise, rounds=0, known=system).log_evidence
    ranked = []
    for effect, first in candidates:
        hypothesis = base.with_effect(effect)
        starts: tuple[Array, ...] = (first, -first) if effect.both_signs else (first,)
        if len(effect.probe_values) > len(effect.parameters):
            starts = tuple(np.array(start) for start in effect.probe_values)
        fits = [
            fitter.fit(
                hypothesis,
                np.concatenate([theta, start]),
                trajectory,
                noise,
                _PRESELECTION_ROUNDS,
                known=system,
            )
            for start in starts
        ]
        does = [fit for fit in fits if not has_no_effect(effect, fit)]
        if does:
            fit = max(does, key=lambda fit: fit.log_evidence)
            ranked.append((effect, fit.theta[len(theta) :], (fit.log_evidence - none) * S / len(some)))
    return sorted(ranked, key=lambda candidate: -candidate[2])


def _simplest(step: Step, rivals: Sequence[Rival]) -> Rival:
    """The best rival, or one with fewer parameters and the same action within law errors."""
    best = rivals[0]
    change = _velocity_change(step, best)
    tied = [best]
    for rival in rivals[1:]:
        if len(rival.effect.parameters) >= len(best.effect.parameters):
            continue
        compared = np.ones(len(change), bool)
        if best.effect.friction and rival.effect.friction and best.effect.part == rival.effect.part:
            compared = _away_from_rest(step, best.effect.part)
        left = float(np.sum((_velocity_change(step, rival) - change)[compared] ** 2))
        if left < LARGEST_LAW_ERROR**2 * float(np.sum(change[compared] ** 2)):
            tied.append(rival)
    return min(tied, key=lambda rival: (len(rival.effect.parameters), -rival.gain))


def _away_from_rest(step: Step, part: str) -> NDArray[np.bool_]:
    """Nodes at which a joint is fast enough for friction laws to hold."""
    problem = step.problem
    joint = next(joint for joint in problem.rig_motion.joints if joint.name == part)
    trajectory = step.scored.fit.trajectory[problem.segments.inside]
    speed = np.abs(trajectory[:, problem.simulator.tangent.nq + joint.v])
    return np.asarray(speed > 2 * LOW_SPEED * joint.speed)


def _velocity_change(step: Step, rival: Rival) -> Array:
    """Velocity change by a rival over an interval, along the trajectory, relative to the torques' effect."""
    problem, trajectory = step.problem, step.scored.fit.trajectory
    segments, simulator = problem.segments, problem.simulator
    n, nq = trajectory.shape[0] * trajectory.shape[1], simulator.tangent.nq
    x, time = trajectory.reshape(n, -1), segments.time.reshape(n)
    order = np.repeat(segments.order, segments.shape[1])
    ends = []
    for hypothesis, theta in (
        (step.hypothesis, step.scored.fit.theta),
        (rival.fit.hypothesis, rival.fit.theta),
    ):
        model = hypothesis.compiled(theta, segments.step)
        u = hypothesis.control(segments, theta).reshape(n, segments.substeps, -1)
        ends.append(simulator.advance(hypothesis, theta, model, x, u, time, order)[0])
    inertia = np.array([1.0] * simulator.tangent.nv)
    for joint in problem.rig_motion.joints:
        inertia[joint.v] = joint.inertia / joint.torque
    difference = (ends[1] - ends[0])[:, nq : nq + simulator.tangent.nv] * inertia
    return np.asarray(difference[segments.inside.reshape(n)])


def refit(step: Step, effect: JointEffect, start: Array, rounds: int = 8) -> Fit:
    """Refit the step's hypothesis with one more effect, under its own process force.

    The first fit uses the process force without the effect, which absorbs part of it.
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
    own = fit_process_force(system, prior, scored.residual_noise, step.problem.segments.interval)
    again = fitter.fit(hypothesis, fit.theta, fit.trajectory, own, _SECOND_ROUNDS, known=system)
    return again if again.log_evidence > fit.log_evidence else fit


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


def _structural_step(before: Step, rival: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """A model with hidden states in place of the best law; None if none is better.

    Args:
        before: without either.
        rival: with that law; `before` itself where no law gains enough.
        rng: for p-values.
        report: receives progress messages.
    """
    problem, scored = before.problem, before.scored
    statistic = {j.name: 0.0 for j in problem.rig_motion.joints}
    for effect, value in zip(scored.effects, before.test.statistics, strict=True):
        if effect.part in statistic:
            statistic[effect.part] = max(statistic[effect.part], float(value))
    parts = sorted(statistic, key=lambda part: -statistic[part])[:_STRUCTURE_JOINTS]
    # All are fitted by shooting to the same segments under the same noise, including the rival.
    own = rival.scored.fit
    law = _shooting_fit(
        rival.problem,
        own.hypothesis,
        own.theta,
        own.trajectory,
        _white_equivalent(scored.noise),
        _segment_subset(problem),
    )
    candidates: list[StructuralFit] = []
    for effect in problem.catalogue:
        if not effect.hidden_state or (effect.part in statistic and effect.part not in parts):
            continue
        report(f"trying {effect.key}")
        candidate = _fit_structure(before, effect)
        if candidate is not None and candidate.fit.log_evidence > law.log_evidence - _STRUCTURE_MARGIN:
            candidates.append(candidate)
    candidates.sort(key=lambda candidate: -candidate.fit.log_evidence)
    if not candidates:
        return None
    level = _refitted_evidence(rival.problem, own, rival.scored.noise)[0]
    best: tuple[float, StructuralFit] | None = None
    for candidate in candidates[:2]:
        if candidate.fit.log_evidence < candidates[0].fit.log_evidence - _STRUCTURE_MARGIN:
            continue
        evidence, whole = _refit_all_segments(candidate)
        report(f"refitted {candidate.effect.key}: {evidence - level:+.1f} nats against the best law")
        if best is None or evidence > best[0]:
            best = evidence, whole
    if best is None or best[0] < level + EQUIVALENCE_NATS:
        return None
    evidence, whole = best
    fit = whole.fit
    scored = fit_and_score(whole.problem, fit.hypothesis, fit.theta, fit.trajectory, whole.noise)
    gain = evidence - level + rival.gain
    rivals = (Rival(whole.effect, gain, fit), *rival.rivals)
    return Step(whole.problem, scored, _test(scored, rng), whole.effect, gain, rivals)


@dataclass(frozen=True)
class StructuralFit:
    """A restructured problem, fitted."""

    effect: JointEffect
    problem: Problem
    fit: Fit
    noise: Noise


def structural_fit(before: Step, effect: JointEffect) -> ScoredFit | None:
    """Fit an effect with hidden states; None where the model cannot be restructured."""
    candidate = _fit_structure(before, effect)
    if candidate is None:
        return None
    _, whole = _refit_all_segments(candidate)
    return fit_and_score(
        whole.problem, whole.fit.hypothesis, whole.fit.theta, whole.fit.trajectory, whole.noise
    )


def _fit_structure(before: Step, effect: JointEffect) -> StructuralFit | None:
    """Fit an effect with hidden states to a subset of segments; None where restructuring fails."""
    problem, scored = before.problem, before.scored
    try:
        moved = problem.restructured(effect, scored.fit.trajectory)
        present = tuple(e.on(moved.rig_motion) for e in (*before.hypothesis.effects, effect))
    except (ValueError, KeyError):
        return None
    hypothesis = Hypothesis(moved.rig, present)
    noise = replace(_white_equivalent(scored.noise), torque=moved.torque, initial=moved.initial_noise.initial)
    theta = np.concatenate([scored.fit.theta, [p.start for p in effect.parameters]])
    return StructuralFit(
        effect,
        moved,
        _shooting_fit(moved, hypothesis, theta, moved.trajectory, noise, _segment_subset(problem)),
        noise,
    )


def _refit_all_segments(candidate: StructuralFit) -> tuple[float, StructuralFit]:
    """Evidence under refitted noise, and the fit to all segments."""
    problem, part = candidate.problem.with_steps_for(candidate.effect), candidate.fit
    every = np.arange(problem.segments.shape[0])
    fit = _shooting_fit(
        problem, part.hypothesis, part.theta, problem.trajectory, candidate.noise, every, rounds=4
    )
    trajectory, initial = _undeflected(problem, fit, candidate.noise)
    evidence, fit, noise = _refitted_evidence(
        problem, replace(fit, trajectory=trajectory), replace(candidate.noise, initial=initial)
    )
    return evidence, replace(candidate, problem=problem, fit=fit, noise=noise)


def _undeflected(problem: Problem, fit: Fit, noise: Noise) -> tuple[Array, Array]:
    """A fit's trajectory from an undeflected state, and variances of initial states about it.

    The variances of hidden states match the range of their motion. With wider ones, such as the range of a
    robot's joints for a plate that tilts by millirad, the evidence would lose the logarithm of the ratio in
    every segment.

    Returns:
        (S, L, nx) and (n,).
    """
    model, tangent, initial, first = (
        problem.rig.model, problem.simulator.tangent, noise.initial.copy(), fit.trajectory[:, 0].copy()
    )  # fmt: skip
    # Indices in a state, and in a change of it.
    hidden = [(int(model.jnt_qposadr[model.dof_jntid[dof]]), dof) for dof in problem.rig.added_dofs]
    hidden += [(tangent.nq + dof, tangent.nv + dof) for dof in problem.rig.added_dofs]
    first[:, [at for at, _ in hidden]] = 0
    trajectory, _ = simulate(problem.simulator, fit.hypothesis, fit.theta, problem.segments, first)
    for at, k in hidden:
        wide = _SPREAD**2 * float(np.mean(trajectory[problem.segments.inside][:, at] ** 2))
        initial[k] = min(initial[k], max(wide, _LEAST_SPREAD * initial[k]))
    return trajectory, initial


def _segment_subset(problem: Problem) -> NDArray[np.intp]:
    S = problem.segments.shape[0]
    return np.unique(np.linspace(0, S - 1, min(S, _STRUCTURE_SEGMENTS)).astype(int))


def _white_equivalent(noise: Noise) -> Noise:
    """The noise without correlation in time, which makes a fit cheap."""
    white = np.sqrt(noise.white**2 + noise.coloured**2)
    return replace(noise, white=white, coloured=np.zeros_like(white))


def _shooting_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    trajectory: Array,
    noise: Noise,
    some: NDArray[np.intp],
    rounds: int = _STRUCTURE_ROUNDS,
) -> Fit:
    """A fit to a subset of segments by shooting."""
    subset = noise.select(some)
    simulator, segments = problem.simulator, problem.segments.select(some)
    return shoot(simulator, hypothesis, theta, segments, trajectory[some], subset, rounds)


def _refitted_evidence(problem: Problem, fit: Fit, noise: Noise) -> tuple[float, Fit, Noise]:
    """Evidence of a fit under refitted noise."""
    hypothesis, fitter = fit.hypothesis, problem.fitter
    system, prior = fitter.system(hypothesis, fit.theta, fit.trajectory)
    noise = fit_noise(system, prior, noise, problem.segments, problem.quantities, near=True)
    still = fitter.fit(hypothesis, fit.theta, fit.trajectory, noise, rounds=0, known=system)
    moved = fitter.fit(hypothesis, fit.theta, fit.trajectory, noise, rounds=4, known=system)
    fit = moved if moved.log_evidence > still.log_evidence else still
    return fit.log_evidence, fit, noise


def _backward_elimination(
    step: Step, free: Sequence[JointEffect], rng: np.random.Generator, report: Report
) -> Step:
    """Remove effects that later ones have made redundant."""
    kept_for_good = {effect.key for effect in free}
    while True:
        fit = step.scored.fit
        effects = fit.hypothesis.effects
        removable = [i for i, e in enumerate(effects) if e.key not in kept_for_good and not e.hidden_state]
        if len([e for e in effects if e.key not in kept_for_good]) < 2 or not removable:
            return step
        threshold = _threshold(step.scored)
        best: Fit | None = None
        for i in removable:
            less = Hypothesis(fit.hypothesis.rig, tuple(e for k, e in enumerate(effects) if k != i))
            keep = np.ones(len(fit.theta), bool)
            keep[fit.hypothesis.slices[i]] = False
            # A quadratic approximation excludes removals that are not worth a refit.
            part = fit.hypothesis.slices[i]
            own = fit.theta[part] - fit.hypothesis.start[part]
            covariance = np.linalg.inv(fit.precision)[part, part]
            if 0.5 * own @ np.linalg.solve(covariance, own) > 4 * threshold:
                continue
            without = step.problem.fitter.fit(
                less, fit.theta[keep], fit.trajectory, step.scored.residual_noise
            )
            if without.log_evidence > fit.log_evidence - threshold and (
                best is None or without.log_evidence > best.log_evidence
            ):
                best = without
        if best is None:
            return step
        report("removed an effect that is no longer needed")
        scored = fit_and_score(step.problem, best.hypothesis, best.theta, best.trajectory, step.scored.noise)
        step = replace(step, scored=scored, test=_test(scored, rng))
