"""Forward search for missing effects: added one at a time, by refits, until nothing is significant.

Columns screen, refits decide. Where no stateless law explains the residual, models with hidden states are
fitted (elasticity or backlash of a joint), by shooting. Free forms are never named: where one explains what
named effects do not, an effect outside the catalogue is missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.fit.law_error import LOW_SPEED
from slapshot.diagnosis.fit.noise import LARGEST_LAW_ERROR, Noise, fit_process_force, posterior_means
from slapshot.diagnosis.inference.mismatch_test import gains, overdispersion, scores
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.selection.free_forms import is_free
from slapshot.diagnosis.selection.problem import Problem, ScoredFit, fit_and_score, is_incredible
from slapshot.diagnosis.selection.pulses import (
    least_worth,
    pushes,
    pushes_set_aside,
    window_nodes,
    windows_set_aside,
)
from slapshot.diagnosis.selection.steps import (
    P_VALUE,
    Report,
    Rival,
    Search,
    Step,
    has_no_effect,
    least_gain,
    nominal_step,
    one_step_values,
    refit,
    step_to,
    test_of,
)
from slapshot.diagnosis.selection.structural_search import structural_step
from slapshot.effects.joints.effect import JointEffect, overrides
from slapshot.effects.joints.external_pulse import ExternalPulse

MAX_EFFECTS = 5
MAX_REFITS = 6  # candidates refitted in a step
# Pairs refitted in a step; last movement of one that is believed; largest law errors in fits of its noise.
_MAX_PAIRS, _MAX_MOVED_SD = 4, 3.0
_PAIR_LAW_ERRORS = (0.01, 0.01, *(LARGEST_LAW_ERROR,) * 3)
_PRESELECTION_NODES, _PRESELECTION_ROUNDS = 2000, 4  # of a preliminary refit
_REFIT_MARGIN, _REFIT_MARGIN_NATS = (
    0.02,
    30.0,
)  # margins behind the best candidate, beyond which none is refitted to all data
_LEAST_PUSH = 0.1  # share of a joint's largest push
_STRUCTURE_STEPS = 2  # steps in which structures are fitted: alone, and besides the best law


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
    nominal = nominal_step(problem, free, rng)
    if not nominal.scored.fit.settled:
        return Search((nominal,), tuple(free))
    steps, by_laws = _forward_search([nominal], rng, report)
    if _set_aside(steps[-1]) and not any(isinstance(step.added, ExternalPulse) for step in steps):
        report("what was set aside is no push: on with it")
        if len(steps) == 1:
            steps = [nominal_step(problem, free, rng, may_set_aside=False)]
        else:
            steps[-1] = _with_windows(steps[-1], None, rng)
        steps, later = _forward_search(steps, rng, report)
        by_laws = later or by_laws
    final = _backward_elimination(steps[-1], free, rng, report)
    if final is not steps[-1]:
        steps.append(final)
    return Search(tuple(steps), tuple(free), tuple(by_laws))


def _forward_search(
    steps: Sequence[Step], rng: np.random.Generator, report: Report
) -> tuple[list[Step], list[Step]]:
    """These steps and more until nothing is significant, and `Search.by_laws`.

    Where windows are set aside, since enormous forces act in them, laws are found without them first; then
    the pushes are added.
    """
    steps, by_laws = list(steps), list[Step]()
    while steps[-1].test.p_value < P_VALUE and len(steps) <= MAX_EFFECTS:
        try:
            single = _forward_step(steps[-1], rng, report)
            before, more = _pair_step(steps[-1], single, rng, report)
            steps[-1], more = before, more or ([] if single is None else [single])
            law = more[-1] if more else before
            split = any(effect.hidden_state for effect in before.hypothesis.effects)
            if len(steps) <= _STRUCTURE_STEPS and not split and _much_is_left(law):
                structure = structural_step(before, law, rng, report)
                if structure is not None:
                    by_laws, more = [*steps, *more] if more else [], [structure]
            if not more:
                break
            steps += more
        except np.linalg.LinAlgError:
            # The effects found so far are kept, and their test remains significant.
            report("a refit diverges: the search ends")
            break
    while _set_aside(steps[-1]) and (pushed := _push_step(steps[-1], rng, report)) is not None:
        steps.append(pushed)
    return steps, by_laws


def with_pushes(found: Search, seed: int, report: Report) -> Search:
    """The search with pushes anew, where others went with a law before them."""
    rng = np.random.default_rng([seed, 2])
    step, steps = found.final, list[Step]()
    if _set_aside(step):
        while (pushed := _push_step(step, rng, report)) is not None:
            steps.append(step := pushed)
    elif rivals := _refitted_pushes(step, 0.0, report):
        best = max(rivals, key=lambda rival: rival.gain)
        if best.gain > least_gain(step.scored):
            steps.append(step_to(step, best.fit, best.effect, best.gain, rivals, rng))
    if not steps:
        return found
    dropped = tuple(effect for effect in found.dropped if not isinstance(effect, ExternalPulse))
    return replace(found, steps=(*found.steps, *steps), dropped=dropped)


def _pushed_windows(problem: Problem, fit: Fit, noise: Noise) -> Array | None:
    """(S, L) further process force in the windows that stand out from a fit; None without any."""
    system, prior = problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    seen = innovations(system, noise.covariances(problem.segments.interval))
    values, speed = posterior_means(seen, prior.at(noise)), problem.speed(fit.trajectory)
    return windows_set_aside(system, values, speed, noise, problem.segments, problem.rig_motion)


def _with_windows(step: Step, set_aside: Array | None, rng: np.random.Generator) -> Step:
    """The step fitted with windows set aside; None for none."""
    fit, noise = step.scored.fit, replace(step.scored.noise, set_aside=set_aside)
    near = set_aside is not None
    scored = fit_and_score(step.problem, fit.hypothesis, fit.theta, fit.trajectory, noise, near=near)
    return replace(step, scored=scored, test=test_of(scored, rng))


def _set_aside(step: Step) -> bool:
    """Whether there are windows with a larger process force of their own."""
    return step.scored.noise.set_aside is not None


def _much_is_left(step: Step) -> bool:
    """Whether a candidate, such as a free form, would still explain something."""
    largest = max((gain.log_evidence for gain in step.scored.gains), default=0.0)
    return step.test.p_value < P_VALUE and largest > least_gain(step.scored)


def _forward_step(step: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """Add the effect with the largest gain; None if none gains enough."""
    scored = step.scored
    threshold = least_gain(scored)
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
    if not _set_aside(step):
        rivals += _refitted_pushes(step, max((rival.gain for rival in rivals), default=0.0), report)
    rivals.sort(key=lambda rival: -rival.gain)
    if not rivals or rivals[0].gain < threshold:
        return None
    best = _simplest(step, rivals)
    if not isinstance(best.effect, ExternalPulse) and best.gain < threshold * _overdispersion(step, best):
        report(f"not added: {best.effect.key}, on which segments disagree too much")
        return None
    return step_to(step, best.fit, best.effect, best.gain, rivals, rng)


def _push_step(step: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """Add the pushes of windows that were set aside; None where they are not worth it."""
    problem, fit = step.problem, step.scored.fit
    system, _ = problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    rivals = _refitted_set_aside(step, system, report)
    best = max(rivals, key=lambda rival: rival.gain, default=None)
    if best is None or best.gain < least_gain(step.scored):
        return None
    # From here only what a constant push leaves is set aside.
    fit, noise = best.fit, step.scored.residual_noise
    windows = _pushed_windows(problem, fit, noise)
    if windows is not None and noise.set_aside is not None:
        windows = np.where(noise.set_aside > 0, windows, 0.0)
    step = replace(step, scored=replace(step.scored, noise=replace(step.scored.noise, set_aside=windows)))
    return step_to(step, fit, best.effect, best.gain, rivals, rng)


def _refitted_pushes(step: Step, leader: float, report: Report) -> list[Rival]:
    """Pushes of each joint, where they may gain a share of what the leader does."""
    problem = step.problem
    present = {effect.key for effect in step.hypothesis.effects}
    rivals: list[Rival] = []
    if step.test.push_p_value >= P_VALUE:
        return rivals
    for push, promise in pushes(step.scored.pulses, problem.segments, problem.rig_motion):
        if push.key not in present and promise > _REFIT_MARGIN * leader:
            refitted = _refitted_push(step, push)
            if refitted is None:
                continue
            push, fit = refitted
            rivals.append(Rival(push, fit.log_evidence - step.scored.fit.log_evidence, fit))
            report(f"refitted {push.name}@{push.part}: {rivals[-1].gain:+.1f} nats")
    return rivals


def _refitted_push(step: Step, push: ExternalPulse) -> tuple[ExternalPulse, Fit] | None:
    """A refit with those pushes that are something beside the joint's others; None where none is.

    The others are errors of their shape, or of the joint's friction where it turns around.
    """
    fit = refit(step, push, np.zeros(len(push.parameters)))
    values = fit.theta[len(fit.theta) - len(push.parameters) :]
    size = np.abs(values)
    large = size > _LEAST_PUSH * max(size.max(), _largest_push(step, push.part))
    if large.all():
        return push, fit
    if not large.any():
        return None
    push = push.only(large)
    return push, refit(step, push, values[large])


def _refitted_set_aside(step: Step, system: Linear, report: Report) -> list[Rival]:
    """Pushes of each joint in the windows that were set aside, compared with one process force everywhere."""
    problem, noise = step.problem, step.scored.residual_noise
    known = [pulse for e in step.hypothesis.effects if isinstance(e, ExternalPulse) for pulse in e.pulses]
    found = pushes_set_aside(system, noise, problem.segments, problem.rig_motion, known)
    level = _evidence_without_set_aside(step) if found else 0.0
    rivals: list[Rival] = []
    for push in found:
        refitted = _refitted_push(step, push)
        if refitted is None:
            continue
        push, fit = refitted
        # Each may have come in any window.
        windows = problem.segments.time.size / window_nodes(problem.segments)
        gain = fit.log_evidence - level - len(push.pulses) * float(np.log(windows))
        rivals.append(Rival(push, gain, fit))
        report(f"refitted {push.name}@{push.part}: {gain:+.1f} nats")
    return rivals


def _largest_push(step: Step, part: str) -> float:
    """Size of the largest push of a joint that is named already; 0 without any."""
    fit = step.scored.fit
    of_joint = [
        float(np.abs(fit.theta[own]).max())
        for effect, own in zip(fit.hypothesis.effects, fit.hypothesis.slices, strict=True)
        if isinstance(effect, ExternalPulse) and effect.part == part
    ]
    return max(of_joint, default=0.0)


def _evidence_without_set_aside(step: Step) -> float:
    """Evidence of the step's fit under one process force everywhere."""
    fit, noise, interval = step.scored.fit, step.scored.residual_noise, step.problem.segments.interval
    if noise.set_aside is None:
        return fit.log_evidence
    system, prior = step.problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    noise = fit_process_force(system, prior, noise.without_set_aside, interval)
    return step.problem.fitter.fit(
        fit.hypothesis, fit.theta, fit.trajectory, noise, rounds=0, known=system
    ).log_evidence


def _pair_step(
    before: Step, single: Step | None, rng: np.random.Generator, report: Report
) -> tuple[Step, list[Step]]:
    """Two steps that add a pair of effects, where it explains far more than the best effect alone; else none.

    One of two large missing forces, fitted alone, takes the values that explain most of both: the other then
    seems useless, and a third that corrects the first is found in its place.

    Returns:
        The step before, with those windows set aside that stand out from the pair, and the two.
    """
    problem, alone = before.problem, 0.0 if single is None else single.gain
    level = before.scored.fit.log_evidence - least_worth(before.scored.noise.set_aside, problem.segments)
    found: list[tuple[_Pair, Rival, Noise]] = []
    for pair in _promising_pairs(before.scored):
        fit, noise = _refit_pair(before, pair)
        gain = fit.log_evidence - least_worth(noise.set_aside, problem.segments) - level
        rival = Rival(pair.second, gain, fit)
        report(f"refitted {pair.first.key} with {pair.second.key}: {rival.gain:+.1f} nats")
        if fit.moved < _MAX_MOVED_SD:
            found.append((pair, rival, noise))
    found.sort(key=lambda one: -one[1].gain)
    if not found or found[0][1].gain < alone + least_gain(before.scored):
        return before, []
    windows = found[0][2].set_aside
    if windows is not None:
        before = _with_windows(before, windows, rng)
        level = before.scored.fit.log_evidence
    first, best = _simplest_pair(before, [(pair, rival) for pair, rival, _ in found], found[0][2])
    only = refit(before, first, best.fit.theta[best.fit.hypothesis.slices[-2]])
    gain = only.log_evidence - level
    step = step_to(before, only, first, gain, [Rival(first, gain, only)], rng)
    both = step_to(before, best.fit, best.effect, best.gain, [best], rng)
    # By itself the first one gains with a process force that makes up for the other: both under one noise.
    noise = both.scored.residual_noise
    without = problem.fitter.fit(step.hypothesis, only.theta, only.trajectory, noise)
    second = max(both.scored.fit.log_evidence - without.log_evidence, best.gain - gain)
    if np.isfinite(second):
        both = replace(both, gain=second, rivals=(replace(best, gain=second),))
    return before, [step, both]


def _simplest_pair(
    before: Step, found: Sequence[tuple["_Pair", Rival]], noise: Noise
) -> tuple[JointEffect, Rival]:
    """The best pair of some, best first, or a simpler one: its first effect, and the second as a rival.

    Those that have an effect in common with the best one are fitted under its noise, about its trajectory: by
    itself each may have stopped on the way.
    """
    problem, (best, rival) = before.problem, found[0]

    def refitted(pair: _Pair, fit: Fit, common: JointEffect) -> Rival:
        effect = pair.second if pair.first is common else pair.first
        hypothesis = before.hypothesis.with_effect(common).with_effect(effect)
        own = dict(zip((e.key for e in fit.hypothesis.effects), fit.hypothesis.slices, strict=True))
        theta = np.concatenate([fit.theta[own[e.key]] for e in hypothesis.effects])
        again = problem.fitter.fit(hypothesis, theta, rival.fit.trajectory, noise)
        if again.log_evidence < fit.log_evidence and hypothesis == fit.hypothesis:
            again = fit
        return Rival(effect, again.log_evidence - before.scored.fit.log_evidence, again)

    for common in (best.first, best.second):
        others = [(pair, other) for pair, other in found[1:] if common in (pair.first, pair.second)]
        if not others:
            continue
        whole = refitted(best, rival.fit, common)
        rivals = [refitted(pair, other.fit, common) for pair, other in others]
        tied = [one for one in rivals if one.gain > whole.gain - least_gain(before.scored)]
        simplest = _simplest(before, [whole, *tied])
        if simplest is not whole:
            return common, simplest
    return best.first, rival


@dataclass(frozen=True)
class _Pair:
    """Two candidates, that of the larger gain first, and their values by one step."""

    first: JointEffect
    second: JointEffect
    first_values: Array
    second_values: Array


def _promising_pairs(scored: ScoredFit) -> list[_Pair]:
    """Pairs of candidates with the largest gains, far above those of any alone; best first.

    One of the two is a friction: missing frictions are as large as what moves a joint, and are mistaken for
    each other and for drives. Two errors of geometry or of readings explain anything by their difference.
    """
    usable = [
        i
        for i, effect in enumerate(scored.effects)
        if not is_free(effect) and not effect.many_forms and np.isfinite(scored.gains[i].log_evidence)
        and len(scored.columns[i]) == len(effect.parameters) and not overrides(effect, "observe")
    ]  # fmt: skip
    alone = max((scored.gains[i].log_evidence for i in usable), default=0.0)
    least = alone + max(least_gain(scored), _REFIT_MARGIN * alone)
    pairs = [
        sorted((i, j), key=lambda k: -scored.gains[k].log_evidence)
        for i, j in combinations(usable, 2)
        if (scored.effects[i].name, scored.effects[i].part)
        != (scored.effects[j].name, scored.effects[j].part)
        and (scored.effects[i].friction or scored.effects[j].friction)
    ]
    if not pairs:
        return []
    both = gains(scored.scores, [np.concatenate([scored.columns[i], scored.columns[j]]) for i, j in pairs])
    found: list[_Pair] = []
    for k in sorted(range(len(pairs)), key=lambda k: -both[k].log_evidence):
        if len(found) == _MAX_PAIRS or both[k].log_evidence <= least:
            break
        (i, j), values = pairs[k], both[k].values
        own = np.split(values, [len(scored.columns[i])])
        effects = scored.effects[i], scored.effects[j]
        if not any(map(is_incredible, effects, own)):
            starts = (one_step_values(scored, n, v) for n, v in zip((i, j), own, strict=True))
            found.append(_Pair(*effects, *starts))
    return found


def _refit_pair(before: Step, pair: _Pair) -> tuple[Fit, Noise]:
    """The step's hypothesis with a pair, and its noise.

    At first laws hardly err: with large errors wrong values explain as much as right ones, and stay. Where
    windows are set aside, laws that explain most of what was left tell better which ones are pushed.
    """
    problem, scored = before.problem, before.scored
    fitter, interval, noise = problem.fitter, problem.segments.interval, scored.residual_noise
    hypothesis = scored.fit.hypothesis.with_effect(pair.first).with_effect(pair.second)
    theta = np.concatenate([scored.fit.theta, pair.first_values, pair.second_values])
    fit = fitter.fit(hypothesis, theta, scored.fit.trajectory, noise, known=scored.system)
    best, level = (fit, noise), -np.inf
    for largest in _PAIR_LAW_ERRORS:
        if not np.isfinite(fit.log_evidence) or has_no_effect(pair.second, fit):
            break
        system, prior = fitter.system(hypothesis, fit.theta, fit.trajectory)
        noise = fit_process_force(system, prior, noise, interval, largest)
        if _set_aside(before):
            windows = _pushed_windows(problem, fit, noise)
            noise = replace(noise, set_aside=noise.set_aside if windows is None else windows)
        fit = fitter.fit(hypothesis, fit.theta, fit.trajectory, noise, known=system)
        gain = fit.log_evidence - least_worth(noise.set_aside, problem.segments)
        if gain > level:
            best, level = (fit, noise), gain
        elif largest == LARGEST_LAW_ERROR:
            break
    return best


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


def _backward_elimination(
    step: Step, free: Sequence[JointEffect], rng: np.random.Generator, report: Report
) -> Step:
    """Remove effects that later ones have made redundant."""
    kept_for_good = {effect.key for effect in free}
    while True:
        fit = step.scored.fit
        effects = fit.hypothesis.effects
        pushed = step.scored.residual_noise.set_aside is not None
        removable = [
            i for i, e in enumerate(effects)
            if e.key not in kept_for_good and not e.hidden_state
            and not (pushed and isinstance(e, ExternalPulse))
        ]  # fmt: skip
        if len([e for e in effects if e.key not in kept_for_good]) < 2 or not removable:
            return step
        threshold = least_gain(step.scored)
        best: Fit | None = None
        least_loss = threshold
        for i in removable:
            noise, evidence = step.scored.residual_noise, fit.log_evidence
            if isinstance(effects[i], ExternalPulse):
                # Under an error of its shape, which none has without it, nearly all of it could be missing.
                noise = replace(noise, push_error=None)
                evidence = step.problem.fitter.fit(
                    fit.hypothesis, fit.theta, fit.trajectory, noise, rounds=0
                ).log_evidence
            less = Hypothesis(fit.hypothesis.rig, tuple(e for k, e in enumerate(effects) if k != i))
            keep = np.ones(len(fit.theta), bool)
            keep[fit.hypothesis.slices[i]] = False
            # A quadratic approximation excludes removals that are not worth a refit.
            part = fit.hypothesis.slices[i]
            own = fit.theta[part] - fit.hypothesis.start[part]
            covariance = np.linalg.inv(fit.precision)[part, part]
            if 0.5 * own @ np.linalg.solve(covariance, own) > 4 * threshold:
                continue
            without = step.problem.fitter.fit(less, fit.theta[keep], fit.trajectory, noise)
            if evidence - without.log_evidence < least_loss:
                least_loss, best = evidence - without.log_evidence, without
        if best is None:
            return step
        report("removed an effect that is no longer needed")
        scored = fit_and_score(step.problem, best.hypothesis, best.theta, best.trajectory, step.scored.noise)
        step = replace(step, scored=scored, test=test_of(scored, rng))
