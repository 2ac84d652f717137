"""Forward search for missing effects: added one at a time, by refits, until nothing is significant.

Columns screen, refits decide. Where no stateless law explains the residual, models with hidden states are
fitted (elasticity or backlash of a joint), by shooting. Free forms are never named: where one explains what
named effects do not, an effect outside the catalogue is missing.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.selection.fine_ripples import fine_ripples
from slapshot.diagnosis.selection.free_forms import is_free
from slapshot.diagnosis.selection.pair_search import pair_step
from slapshot.diagnosis.selection.problem import Problem, fit_and_score
from slapshot.diagnosis.selection.push_search import (
    gain_elsewhere,
    has_laws,
    has_windows_set_aside,
    push_step,
    refitted_pushes,
    with_windows,
    without_needless_windows,
    worth_of_set_aside,
)
from slapshot.diagnosis.selection.simplest import SIMPLER_MARGIN, simplest
from slapshot.diagnosis.selection.steps import (
    EQUIVALENCE_NATS,
    P_VALUE,
    REFIT_MARGIN,
    REFIT_MARGIN_NATS,
    Report,
    Rival,
    Search,
    Step,
    has_no_effect,
    least_gain,
    mismatch_and_push_test,
    nominal_motion,
    nominal_step,
    one_step_values,
    refit,
    rival_overdispersion,
    step_to,
)
from slapshot.diagnosis.selection.structural_search import structural_step
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.external_pulse import ExternalPulse

MAX_EFFECTS = 5
MAX_REFITS = 6  # candidates refitted in a step
_PRESELECTION_NODES, _PRESELECTION_ROUNDS = 2000, 4  # of a preliminary refit
_OPEN_P_VALUE = 0.1  # of what laws leave, below which structures are fitted besides
_STRUCTURE_LAWS = 1  # largest number of laws besides which structures are fitted
_STRUCTURE_STEPS = 2  # steps in which they are fitted besides the same laws, which pushes alone tell apart


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
    motion = nominal_motion(problem, free)
    nominal = nominal_step(motion, rng)
    if not nominal.scored.fit.settled:
        return Search((nominal,), tuple(free))
    steps, by_laws, by_structure = _forward_search([nominal], rng, report)
    if has_windows_set_aside(steps[-1]) and not any(map(_is_push, steps)):
        report("what was set aside is no push: on with it")
        if len(steps) == 1:
            steps = [nominal_step(motion, rng, may_set_aside=False)]
        else:
            steps[-1] = with_windows(steps[-1], None, rng)
        steps, *later = _forward_search(steps, rng, report)
        by_laws, by_structure = later[0] or by_laws, later[1] or by_structure
    try:
        final = _backward_elimination(steps[-1], free, rng, report)
    except np.linalg.LinAlgError:
        report("a refit with fewer effects diverges: all stay")
        final = steps[-1]
    if final is not steps[-1]:
        steps.append(final)
    return Search(tuple(steps), tuple(free), tuple(by_laws), tuple(by_structure))


def _forward_search(
    steps: Sequence[Step], rng: np.random.Generator, report: Report
) -> tuple[list[Step], list[Step], list[Step]]:
    """These steps and more until nothing is significant, `Search.by_laws` and `Search.by_structure`.

    Once something was found, a law that gains enough is added also where a test leaves it open: laws that are
    not complete leave so large a force of the process that what they lack is hardly significant.

    Where windows are set aside, since enormous forces act in them, laws are found without them first; then
    the pushes are added, before laws that gain less than the windows are worth.
    """
    steps, by_laws, by_structure = list(steps), list[Step](), list[Step]()
    fitted = Counter[int]()  # by number of laws, steps in which structures were fitted
    while (
        steps[-1].test.p_value < (_OPEN_P_VALUE if len(steps) > 1 else P_VALUE) and len(steps) <= MAX_EFFECTS
    ):
        more = list[Step]()
        try:
            last = steps[-1]
            if has_windows_set_aside(last) and has_laws(last.hypothesis) and worth_of_set_aside(last) < 0:
                steps[-1] = without_needless_windows(last, rng)
                if steps[-1] is not last:
                    continue
            single = _forward_step(steps[-1], rng, report)
            before = steps[-1]
            if has_windows_set_aside(before) and single is not None and _is_push(single):
                steps.append(single)
                continue
            significant = before.test.p_value < P_VALUE
            left = single is None or single.test.p_value < P_VALUE or has_windows_set_aside(before)
            if significant and left:
                before, more = pair_step(before, single, rng, report)
            steps[-1], more = before, more or ([] if single is None else [single])
            split = any(effect.hidden_state for effect in before.hypothesis.effects)
            laws = sum(not _is_push(step) for step in steps[1:])
            if (
                significant
                and laws <= _STRUCTURE_LAWS
                and fitted[laws] < _STRUCTURE_STEPS
                and not split
                and _much_is_left(more[-1] if more else before)
            ):
                fitted[laws] += 1
                structure = structural_step(before, more, rng, report)
                gained = sum(step.gain for step in more) + EQUIVALENCE_NATS
                if structure is not None and structure.gain >= gained:
                    by_laws, more = [*steps, *more] if more else [], [structure]
                elif structure is not None and more:
                    by_structure = [*steps, structure]
        except np.linalg.LinAlgError:
            # The effects found so far are kept, laws of this step that a structure was to replace among them.
            report("a refit diverges: the search ends")
            steps += more
            break
        if not more:
            break
        steps += more
    try:
        while has_windows_set_aside(steps[-1]) and (pushed := push_step(steps[-1], rng, report)) is not None:
            steps.append(pushed)
    except np.linalg.LinAlgError:
        report("a refit with pushes diverges: the search ends")
    return steps, by_laws, by_structure


def _is_push(step: Step) -> bool:
    """Whether a step added pushes."""
    return isinstance(step.added, ExternalPulse)


def _pushes_come_first(step: Step, rivals: Sequence[Rival]) -> bool:
    """Whether laws are found, and windows set aside are worth more than any further candidate gains."""
    if not (has_windows_set_aside(step) and has_laws(step.hypothesis)):
        return False
    return worth_of_set_aside(step) > max([least_gain(step.scored), *(rival.gain for rival in rivals)])


def _much_is_left(step: Step) -> bool:
    """Whether a candidate, such as a free form, would still explain something, or a test leaves it open.

    Laws that stand in for a hidden state may explain so much that what is left is hardly significant.
    """
    largest = max((gain.log_evidence for gain in step.scored.gains), default=0.0)
    significant, p_value = largest > least_gain(step.scored), step.test.p_value
    return (significant and p_value < P_VALUE) or P_VALUE <= p_value < _OPEN_P_VALUE


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
    trials: dict[str, float] = {}
    # With windows set aside they would leave so little process force that pushes do not converge.
    for ripple in [] if has_windows_set_aside(step) else fine_ripples(step):
        trials[ripple.effect.key] = ripple.trials
        candidates[ripple.effect.key] = ripple.effect, ripple.start
    leader = -np.inf
    screened = {scored.effects[i].key: found[i].log_evidence for i in order}
    most = max(
        (screened[effect.key] for effect, _ in candidates.values() if effect.key in screened), default=0.0
    )
    for effect, start, gain in _preselect(step, list(candidates.values())):
        # What columns do not tell apart is refitted, too: a preliminary fit may be far from its optimum.
        as_good = _near(screened.get(effect.key, -np.inf), most)
        if not (_near(gain, leader) or as_good) and not any(
            _may_simplify(effect, rival.effect) and gain > (1 - SIMPLER_MARGIN) * leader for rival in rivals
        ):
            continue
        fit = refit(step, effect, start)
        # Of those that were detected, each may have had any order.
        gained = fit.log_evidence - scored.fit.log_evidence - trials.get(effect.key, 0.0)
        rival = Rival(effect, gained, fit)
        report(
            f"refitted {effect.key}: {rival.gain:+.1f} nats{', at no size' if rival.has_no_effect else ''}"
        )
        if not rival.has_no_effect:
            leader = max(leader, gain)
            rivals.append(rival)
    if not has_windows_set_aside(step):
        rivals += refitted_pushes(step, max((rival.gain for rival in rivals), default=0.0), report)
    rivals.sort(key=lambda rival: -rival.gain)
    if _pushes_come_first(step, rivals) and (pushed := push_step(step, rng, report)) is not None:
        return pushed
    while rivals and rivals[0].gain >= threshold and gain_elsewhere(step, rivals[0]) < threshold:
        report(f"not added: {rivals[0].effect.key}, which explains but what was set aside")
        rivals.pop(0)
    if not rivals or rivals[0].gain < threshold:
        return None
    best = simplest(step, rivals)
    if not isinstance(best.effect, ExternalPulse) and best.gain < threshold * rival_overdispersion(
        step, best
    ):
        report(f"not added: {best.effect.key}, on which segments disagree too much")
        return None
    return step_to(step, best.fit, best.effect, best.gain, rivals, rng)


def _near(gain: float, leader: float) -> bool:
    """Whether a gain is near the largest, as far as a linearisation tells."""
    return gain >= leader - max(REFIT_MARGIN_NATS, REFIT_MARGIN * leader)


def _may_simplify(effect: JointEffect, of: JointEffect) -> bool:
    """Whether a friction has fewer parameters than another one of the same joint."""
    both = effect.friction and of.friction and effect.part == of.part
    return both and len(effect.parameters) < len(of.parameters)


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
            # Where the others can stand in for it, their values without it lie far away.
            rest = fit.precision[keep]
            start = fit.theta[keep] + np.linalg.solve(rest[:, keep], rest[:, part] @ own)
            without = step.problem.fitter.fit(less, start, fit.trajectory, noise)
            if evidence - without.log_evidence < least_loss:
                least_loss, best = evidence - without.log_evidence, without
        if best is None:
            return step
        report("removed an effect that is no longer needed")
        scored, of = fit_and_score(
            step.problem, best.hypothesis, best.theta, best.trajectory, step.scored.noise
        )
        step = replace(step, scored=scored, test=mismatch_and_push_test(scored, of, rng))
