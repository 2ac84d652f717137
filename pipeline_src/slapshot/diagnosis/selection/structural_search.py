"""Search for models with hidden states, such as elasticity or backlash of a joint, by shooting."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.fit import Fit, Fitter
from slapshot.diagnosis.fit.noise import Noise, fit_noise, fit_process_force
from slapshot.diagnosis.fit.shooting import MOST_ROUNDS, fit_first_states, shoot, simulate
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.problem import Problem, ScoredFit, fit_and_score
from slapshot.diagnosis.selection.steps import Report, Rival, Step, mismatch_and_push_test
from slapshot.effects.joints.effect import JointEffect

_JOINTS = 3  # with the largest scores
_ROUNDS, _SEGMENTS = 6, 12  # of a preliminary fit
_MOST_WHOLE = 2  # of the best ones that are fitted to all segments
_SPREAD, _LEAST_SPREAD = (
    3.0,
    1e-8,
)  # prior sd of a hidden initial state, in rms of its motion; minimum share of its variance
_MARGIN = 20.0  # nats behind the best law, beyond which a structure is dropped; nearer, held-out data decide
_HOPELESS = 100.0  # the same by some segments, each under the noise that it leaves there


def structural_step(
    before: Step, laws: Sequence[Step], rng: np.random.Generator, report: Report
) -> Step | None:
    """A model with hidden states in place of the best laws; None where these explain clearly more.

    Args:
        before: without either.
        laws: steps that add the best law or two; none where no law gains enough.
        rng: for p-values.
        report: receives progress messages.
    """
    problem, scored, rival = before.problem, before.scored, laws[-1] if laws else before
    statistic = {j.name: 0.0 for j in problem.rig_motion.joints}
    for effect, value in zip(scored.effects, before.test.statistics, strict=True):
        if effect.part in statistic:
            statistic[effect.part] = max(statistic[effect.part], float(value))
    parts = sorted(statistic, key=lambda part: -statistic[part])[:_JOINTS]
    # All are fitted by shooting to the same segments under the same noise, including the rival.
    own, some = rival.scored.fit, _segment_subset(problem, scored.noise)
    noise = _white_equivalent(scored.noise)
    law = _shooting_fit(rival.problem, own.hypothesis, own.theta, own.trajectory, noise, some)
    level = law.log_evidence - _MARGIN
    candidates: list[StructuralFit] = []
    for effect in problem.catalogue:
        if not effect.hidden_state or (effect.part in statistic and effect.part not in parts):
            continue
        report(f"trying {effect.key}")
        candidate = _fit_structure(before, effect, report, level)
        if candidate is not None and np.isfinite(candidate.fit.log_evidence):
            candidates.append(candidate)
    candidates.sort(key=lambda candidate: -candidate.fit.log_evidence)
    candidates = [_converged(candidate, some, level) for candidate in candidates[:_MOST_WHOLE]]
    candidates.sort(key=lambda candidate: -candidate.fit.log_evidence)
    if not candidates or candidates[0].fit.log_evidence < level:
        return None
    nearest = [c for c in candidates if c.fit.log_evidence >= candidates[0].fit.log_evidence - _MARGIN]
    candidates = _not_hopeless(nearest, rival, some, report)
    if not candidates:
        return None
    # From the noise that candidates leave, a fit may end at a lower one of several optima.
    whole_law, *_ = _refitted_evidence(rival.problem.fitter, problem.quantities, own, rival.scored.noise)
    level = max(own.log_evidence, whole_law)
    refitted = []
    for candidate in candidates:
        refitted.append(_refit_all_segments(candidate))
        gain = refitted[-1][0] - level
        report(f"refitted {candidate.effect.key}: {gain:+.1f} nats against the best law")
    evidence, whole = max(refitted, key=lambda one: one[0])
    if evidence < level - _MARGIN:
        return None
    fit = whole.fit
    scored, of = fit_and_score(whole.problem, fit.hypothesis, fit.theta, fit.trajectory, whole.noise)
    gain = evidence - level + sum(step.gain for step in laws)
    # Laws that it does not explain more than are told apart by held-out data, if at all.
    rivals = (Rival(whole.effect, gain, fit), *(rival.rivals if laws and evidence >= level else ()))
    return Step(whole.problem, scored, mismatch_and_push_test(scored, of, rng), whole.effect, gain, rivals)


@dataclass(frozen=True)
class StructuralFit:
    """A restructured problem, fitted.

    Attributes:
        effect: by which it is restructured.
        problem: the restructured one.
        start: first values.
        fit: of all effects.
        noise: by which it is fitted; white as long as that is by shooting.
        own_noise: the same with its correlation in time, before it is refitted.
    """

    effect: JointEffect
    problem: Problem
    start: Array
    fit: Fit
    noise: Noise
    own_noise: Noise


def _not_hopeless(
    candidates: Sequence[StructuralFit], law: Step, some: NDArray[np.intp], report: Report
) -> list[StructuralFit]:
    """Those that may explain as much as a law, by some segments, each under the noise that it leaves there.

    Under one noise both may explain so little that a fit to all segments, which is slow, seems worth it.
    """
    fit, quantities = law.scored.fit, law.problem.quantities
    of_some = replace(fit, trajectory=fit.trajectory[some])
    fitter, noise = law.problem.fitter.select(some), law.scored.noise.select(some)
    level, *_ = _refitted_evidence(fitter, quantities, of_some, noise)
    near = []
    for candidate in candidates:
        own, *_ = _evidence_of(candidate, candidate.problem.fitter.select(some), candidate.fit, some)
        if own >= level - _HOPELESS:
            near.append(candidate)
        else:
            report(f"not refitted: {candidate.effect.key}, {level - own:.0f} nats behind on some segments")
    return near


def structural_fit(before: Step, effect: JointEffect) -> ScoredFit | None:
    """Fit an effect with hidden states; None where the model cannot be restructured."""
    candidate = _fit_structure(before, effect, lambda text: None)
    if candidate is None:
        return None
    _, whole = _refit_all_segments(candidate)
    scored, _ = fit_and_score(
        whole.problem, whole.fit.hypothesis, whole.fit.theta, whole.fit.trajectory, whole.noise
    )
    return scored


def _fit_structure(
    before: Step, effect: JointEffect, report: Report, level: float = -np.inf
) -> StructuralFit | None:
    """Fit an effect with hidden states to a subset of segments; None where there is no such model.

    It is given up where it cannot reach a level of log evidence.
    """
    problem, scored = before.problem, before.scored
    try:
        moved = problem.restructured(effect, scored.fit.trajectory)
        present = tuple(e.on(moved.rig_motion) for e in (*before.hypothesis.effects, effect))
    except (ValueError, KeyError) as error:
        report(f"{effect.key} cannot be tried on this model: {error}")
        return None
    hypothesis = Hypothesis(moved.rig, present)
    own = replace(scored.noise, torque=moved.torque, initial=moved.initial_noise.initial)
    noise = _white_equivalent(own)
    theta = np.concatenate([scored.fit.theta, [p.start for p in effect.parameters]])
    some = _segment_subset(problem, scored.noise)
    fit = _shooting_fit(moved, hypothesis, theta, moved.trajectory, noise, some, _ROUNDS, level)
    return StructuralFit(effect, moved, theta, fit, noise, own)


def _converged(candidate: StructuralFit, some: NDArray[np.intp], level: float) -> StructuralFit:
    """The same, fitted until it converges, for some rounds more.

    From its first values: from where it was, with undeflected initial states, it may end elsewhere.
    """
    problem, fit = candidate.problem, candidate.fit
    if fit.converged:
        return candidate
    hypothesis, trajectory = fit.hypothesis, problem.trajectory
    again = _shooting_fit(
        problem, hypothesis, candidate.start, trajectory, candidate.noise, some, MOST_ROUNDS, level
    )
    return replace(candidate, fit=again) if again.log_evidence > fit.log_evidence else candidate


def _refit_all_segments(candidate: StructuralFit) -> tuple[float, StructuralFit]:
    """Evidence under refitted noise, and the fit to all segments."""
    problem, part = candidate.problem.with_steps_for(candidate.effect), candidate.fit
    every = np.arange(problem.segments.shape[0])
    some = problem.segments.select(_segment_subset(problem, candidate.noise))
    noise = replace(candidate.noise, initial=_initial_variances(problem, some, part, candidate.noise))
    # First states by themselves: beside wrong ones, that are far from the data, all values would move.
    trajectory = fit_first_states(
        problem.simulator, part.hypothesis, part.theta, problem.segments, problem.trajectory, noise,
        MOST_ROUNDS,
    )  # fmt: skip
    fit = _shooting_fit(problem, part.hypothesis, part.theta, trajectory, noise, every, MOST_ROUNDS)
    evidence, fit, noise = _evidence_of(candidate, problem.fitter, fit, every)
    return evidence, replace(candidate, problem=problem, fit=fit, noise=noise)


def _evidence_of(
    candidate: StructuralFit, fitter: Fitter, fit: Fit, some: NDArray[np.intp]
) -> tuple[float, Fit, Noise]:
    """Evidence of a candidate's fit to some segments, which are the fitter's, under refitted noise."""
    initial = _initial_variances(candidate.problem, fitter.segments, fit, candidate.noise)
    noises = [replace(of, initial=initial).select(some) for of in (candidate.noise, candidate.own_noise)]
    # About undeflected first states. All further nodes stay: a motion simulated from these is far from the
    # data, and a filter about it would need a process force that is not there.
    trajectory = fit.trajectory.copy()
    trajectory[:, 0, [at for at, _ in _hidden_states(candidate.problem)]] = 0
    fit = replace(fit, trajectory=trajectory)
    return _refitted_evidence(fitter, candidate.problem.quantities, fit, *noises)


def _hidden_states(problem: Problem) -> list[tuple[int, int]]:
    """Indices of hidden positions and velocities in a state, and in a change of it."""
    rig, tangent = problem.rig, problem.simulator.tangent
    at = [int(rig.model.jnt_qposadr[rig.model.dof_jntid[dof]]) for dof in rig.added_dofs]
    return [*zip(at, rig.added_dofs, strict=True)] + [
        (tangent.nq + dof, tangent.nv + dof) for dof in rig.added_dofs
    ]


def _initial_variances(problem: Problem, segments: Segments, fit: Fit, noise: Noise) -> Array:
    """Variances (n,) of first states, those of hidden states by the range of their motion.

    With wider ones, such as the range of a robot's joints for a plate that tilts by millirad, the evidence
    would lose the logarithm of the ratio in every segment, and first states that nobody sees would go far.
    The range is that of motions with a fit's values from undeflected states: what loads do.
    """
    initial, first, hidden = noise.initial.copy(), fit.trajectory[:, 0].copy(), _hidden_states(problem)
    first[:, [at for at, _ in hidden]] = 0
    driven, _ = simulate(problem.simulator, fit.hypothesis, fit.theta, segments, first)
    for at, k in hidden:
        wide = _SPREAD**2 * float(np.mean(driven[segments.inside][:, at] ** 2))
        initial[k] = min(initial[k], max(wide, _LEAST_SPREAD * initial[k]))
    return initial


def _segment_subset(problem: Problem, noise: Noise) -> NDArray[np.intp]:
    """Some segments; where there are enough, without windows set aside: shooting knows no force in these."""
    some = np.arange(problem.segments.shape[0])
    if noise.set_aside is not None:
        quiet = np.flatnonzero(~(noise.set_aside > 0).any(axis=1))
        some = quiet if len(quiet) >= _SEGMENTS else some
    return some[np.unique(np.linspace(0, len(some) - 1, min(len(some), _SEGMENTS)).astype(int))]


def _white_equivalent(noise: Noise) -> Noise:
    """The noise without correlation in time, which makes a fit cheap."""
    return replace(noise.with_white(noise.single), coloured=np.zeros_like(noise.white))


def _shooting_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    trajectory: Array,
    noise: Noise,
    some: NDArray[np.intp],
    rounds: int = _ROUNDS,
    level: float = -np.inf,
) -> Fit:
    """A fit to a subset of segments by shooting."""
    subset = noise.select(some)
    simulator, segments = problem.simulator, problem.segments.select(some)
    return shoot(simulator, hypothesis, theta, segments, trajectory[some], subset, rounds, level=level)


def _refitted_evidence(
    fitter: Fitter, quantities: Sequence[str], fit: Fit, *noises: Noise
) -> tuple[float, Fit, Noise]:
    """Evidence of a fit under refitted noise, from the best of several initial ones.

    Where a model leaves forces, a fit of all noise may end at a lower one of several optima than one of
    forces and law errors at given noise of the readings.
    """
    hypothesis, segments = fit.hypothesis, fitter.segments
    system, prior = fitter.system(hypothesis, fit.theta, fit.trajectory)

    def still(noise: Noise) -> Fit:
        return fitter.fit(hypothesis, fit.theta, fit.trajectory, noise, rounds=0, known=system)

    found = [fit_process_force(system, prior, noise, segments.interval) for noise in noises]
    evidence = [still(noise).log_evidence for noise in found]
    best = max(range(len(found)), key=lambda k: evidence[k])
    noise = fit_noise(system, prior, found[best], segments, quantities, near=True)
    rest = still(noise)
    if rest.log_evidence < evidence[best]:
        noise, rest = found[best], still(found[best])
    moved = fitter.fit(hypothesis, fit.theta, fit.trajectory, noise, rounds=4, known=system)
    fit = moved if moved.log_evidence > rest.log_evidence else rest
    return fit.log_evidence, fit, noise
