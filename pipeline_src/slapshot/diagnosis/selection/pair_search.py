"""Steps that add a pair of effects at once.

One of two large missing forces, fitted alone, takes the values that explain most of both: the other then
seems useless, and a third that corrects the first is found in its place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.fit import Fit
from slapshot.diagnosis.fit.noise import LARGEST_LAW_ERROR, Noise, fit_process_force
from slapshot.diagnosis.inference.mismatch_test import gains
from slapshot.diagnosis.selection.free_forms import is_free
from slapshot.diagnosis.selection.problem import ScoredFit, is_incredible, largest_law_error
from slapshot.diagnosis.selection.pulses import least_worth
from slapshot.diagnosis.selection.push_search import (
    gain_elsewhere,
    has_windows_set_aside,
    pushed_windows,
    with_windows,
)
from slapshot.diagnosis.selection.simplest import simplest
from slapshot.diagnosis.selection.steps import (
    REFIT_MARGIN,
    REFIT_MARGIN_NATS,
    Report,
    Rival,
    Step,
    has_no_effect,
    least_gain,
    one_step_values,
    refit,
    rival_overdispersion,
    step_to,
)
from slapshot.effects.joints.effect import JointEffect, overrides

# Pairs refitted in a step; last movement of one that is believed; largest law errors in fits of its noise.
_MAX_PAIRS, _MAX_MOVED_SD = 4, 3.0
_PAIR_LAW_ERRORS = (0.003, 0.01, 0.03, 0.1, *(LARGEST_LAW_ERROR,) * 2)
# Segments in which pairs are compared first, and the share of a least gain that the best must reach there:
# gains differ between segments.
_PRESELECTION_SEGMENTS, _HOPELESS = 12, 0.5
_LEAST_TRIED, _BEHIND_NATS = 2, 100.0  # of these, and the distance behind a leader at which a pair is left


def pair_step(
    before: Step, single: Step | None, rng: np.random.Generator, report: Report
) -> tuple[Step, list[Step]]:
    """Two steps that add a pair of effects, where it explains far more than the best effect alone; else none.

    Returns:
        The step before, with those windows set aside that stand out from the pair, and the two.
    """
    problem, alone = before.problem, 0.0 if single is None else single.gain
    level = before.scored.fit.log_evidence - least_worth(before.scored.noise.set_aside, problem.segments)
    found: list[tuple[_Pair, Rival, Noise]] = []
    most, leader = -np.inf, list[float]()
    least = alone + least_gain(before.scored)
    for pair in _preselected(before, single, _promising_pairs(before.scored), least):
        fit, noise, by_law_error = _refit_by_law_error(before, pair.added, leader)
        gain = fit.log_evidence - least_worth(noise.set_aside, problem.segments) - level
        if gain > most:
            most, leader = gain, by_law_error
        rival = Rival(pair.second, gain, fit)
        report(f"refitted {pair.first.key} with {pair.second.key}: {rival.gain:+.1f} nats")
        if fit.moved < _MAX_MOVED_SD and _describe(fit, pair):
            found.append((pair, rival, noise))
    found.sort(key=lambda one: -one[1].gain)
    if not found or found[0][1].gain < least:
        return before, []
    given, windows = before, found[0][2].set_aside
    if windows is not None:
        before = with_windows(before, windows, rng)
        level = before.scored.fit.log_evidence
    first, best = _simplest_pair(before, [(pair, rival) for pair, rival, _ in found], found[0][2])
    least = least_gain(before.scored) * rival_overdispersion(before, best, 2)
    if best.gain < least:
        report(f"not added: {first.key} with {best.effect.key}, on which segments disagree too much")
        return given, []
    if gain_elsewhere(before, best) < least_gain(before.scored):
        report(f"not added: {first.key} with {best.effect.key}, which explain but what was set aside")
        # The best single effect was fitted with the windows of before.
        return before if single is None else given, []
    only = refit(before, first, best.fit.theta[best.fit.hypothesis.slices[-2]])
    gain = only.log_evidence - level
    step = step_to(before, only, first, gain, [Rival(first, gain, only)], rng)
    # Each model under the process force that it leaves: under that of both, the first alone is impossible.
    second = replace(best, gain=best.gain - gain)
    return before, [step, step_to(before, best.fit, best.effect, second.gain, [second], rng)]


def _simplest_pair(
    before: Step, found: Sequence[tuple["_Pair", Rival]], noise: Noise
) -> tuple[JointEffect, Rival]:
    """The best pair of some, best first, or one that explains more under its noise, or is simpler.

    Its first effect, and the second as a rival.

    Those that have an effect in common with the best one are fitted under its noise, about its trajectory: by
    itself each may have stopped on the way.
    """
    problem, (best, rival) = before.problem, found[0]
    # Gains are those of the pairs as they were found, less the worth of the windows that each set aside.
    level = rival.fit.log_evidence - least_worth(noise.set_aside, problem.segments) - rival.gain

    def refitted(pair: _Pair, alone: Rival, common: JointEffect) -> Rival:
        effect = pair.second if pair.first is common else pair.first
        hypothesis = before.hypothesis.with_effect(common).with_effect(effect)
        own, of_best = _values_by_effect(alone.fit), _values_by_effect(rival.fit)
        # What both have in common is where the best one found it.
        of = own | {key: of_best[key] for key in own if key in of_best}
        theta = np.concatenate([of[e.key] for e in hypothesis.effects])
        again = problem.fitter.fit(hypothesis, theta, rival.fit.trajectory, noise)
        gain = again.log_evidence - least_worth(noise.set_aside, problem.segments) - level
        lower = gain < alone.gain and (alone.fit.settled or not again.settled)
        worse = again.moved >= _MAX_MOVED_SD or lower
        if worse and hypothesis == alone.fit.hypothesis:
            return replace(alone, effect=effect)
        return Rival(effect, gain, again)

    for common in (best.first, best.second):
        others = [(pair, other) for pair, other in found[1:] if common in (pair.first, pair.second)]
        if not others:
            continue
        whole = refitted(best, rival, common)
        rivals = [refitted(pair, other, common) for pair, other in others]
        moving = [one for one in rivals if one.fit.moved < _MAX_MOVED_SD]
        leader = max([whole, *moving], key=lambda one: one.gain)
        tied = [one for one in (whole, *moving) if one.gain > leader.gain - least_gain(before.scored)]
        chosen = simplest(before, sorted(tied, key=lambda one: -one.gain))
        if chosen is not whole:
            return common, _relative_to(before, chosen)
    return best.first, _relative_to(before, rival)


def _relative_to(before: Step, rival: Rival) -> Rival:
    """A rival with its gain against a step, whose evidence is that with the same windows set aside."""
    return replace(rival, gain=rival.fit.log_evidence - before.scored.fit.log_evidence)


def _describe(fit: Fit, pair: "_Pair") -> bool:
    """Whether both effects of a pair are there with the fitted values."""
    values = _values_by_effect(fit)
    return all(effect.describes(values[effect.key]) for effect in (pair.first, pair.second))


def _values_by_effect(fit: Fit) -> dict[str, Array]:
    """Key of each effect of a fit -> its values."""
    hypothesis = fit.hypothesis
    return {e.key: fit.theta[own] for e, own in zip(hypothesis.effects, hypothesis.slices, strict=True)}


_Added = tuple[JointEffect, Array]


@dataclass(frozen=True)
class _Pair:
    """Two candidates, that of the larger gain first, and their values by one step."""

    first: JointEffect
    second: JointEffect
    first_values: Array
    second_values: Array

    @property
    def added(self) -> list[_Added]:
        """Both with where their fit begins."""
        return [(self.first, self.first_values), (self.second, self.second_values)]


def _promising_pairs(scored: ScoredFit) -> list[_Pair]:
    """Pairs of candidates with the largest gains, far above those of any alone; best first.

    One of the two is the first friction of its joint: missing frictions are as large as what moves a joint,
    and are mistaken for each other and for drives. Two errors of geometry or of readings explain anything by
    their difference.
    """
    named = {effect.part for effect in scored.fit.hypothesis.effects if effect.friction}
    first = [effect.friction and effect.part not in named for effect in scored.effects]
    usable = [
        i
        for i, effect in enumerate(scored.effects)
        if not is_free(effect) and not effect.many_forms and np.isfinite(scored.gains[i].log_evidence)
        and len(scored.columns[i]) == len(effect.parameters) and not overrides(effect, "observe")
    ]  # fmt: skip
    alone = max((scored.gains[i].log_evidence for i in usable), default=0.0)
    least = alone + max(least_gain(scored), REFIT_MARGIN * alone)
    pairs = [
        sorted((i, j), key=lambda k: -scored.gains[k].log_evidence)
        for i, j in combinations(usable, 2)
        if (scored.effects[i].name, scored.effects[i].part)
        != (scored.effects[j].name, scored.effects[j].part)
        and (first[i] or first[j])
    ]
    if not pairs:
        return []
    columns = [np.concatenate([scored.columns[i], scored.columns[j]]) for i, j in pairs]
    both = gains(scored.eliminated, columns)
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


def _preselected(before: Step, single: Step | None, pairs: Sequence[_Pair], least: float) -> list[_Pair]:
    """Those near the best in fits to a subset of segments; none where all are far from a least gain.

    Nor where the best single effect, fitted to the same segments in the same way, explains more: a pair
    of which one stands in for the other does not stand out from it. Where there are few segments, all are
    left.
    """
    problem, scored = before.problem, before.scored
    S = problem.segments.shape[0]
    some = np.unique(np.linspace(0, S - 1, min(S, _PRESELECTION_SEGMENTS)).astype(int))
    if 2 * len(some) > S:
        return list(pairs)
    fitter, noise, base = problem.fitter.select(some), scored.residual_noise.select(some), scored.fit
    system, trajectory = scored.system.select(some), base.trajectory[some]
    none = fitter.fit(base.hypothesis, base.theta, trajectory, noise, rounds=0, known=system).log_evidence
    none -= least_worth(noise.set_aside, fitter.segments)
    gained: list[float] = []
    leader = list[float]()
    for pair in pairs:
        *_, found = _refit_by_law_error(before, pair.added, leader, some)
        most = max(found, default=-np.inf) - none
        if most > max(gained, default=-np.inf):
            leader = found
        gained.append(most * S / len(some))
    best = max(gained, default=-np.inf)
    if best < _HOPELESS * least:
        return []
    if (alone := _alone(before, single)) is not None:
        *_, found = _refit_by_law_error(before, [alone], leader, some)
        if max(found, default=-np.inf) > max(leader):
            return []
    nearest = best - max(REFIT_MARGIN_NATS, REFIT_MARGIN * best)
    return [pair for pair, gain in zip(pairs, gained, strict=True) if gain >= nearest]


def _alone(before: Step, single: Step | None) -> _Added | None:
    """The effect that a step adds, and where its fit begins; None where it has no columns."""
    if single is None or single.added is None:
        return None
    scored = before.scored
    for i, effect in enumerate(scored.effects):
        if effect.key == single.added.key:
            return effect, one_step_values(scored, i, scored.gains[i].values)
    return None


def _refit_by_law_error(
    before: Step, added: Sequence[_Added], leader: Sequence[float], some: NDArray[np.intp] | None = None
) -> tuple[Fit, Noise, list[float]]:
    """The step's hypothesis with further effects, its noise, and the evidence by how much laws may err.

    At first laws hardly err, then more and more: with large errors wrong values explain as much as right
    ones, and stay. It ends early where the evidence falls far behind a leader's. Where windows are set aside,
    laws that explain most of what was left tell better which ones are pushed.

    Args:
        before: without them.
        added: effects, and where their fit begins.
        leader: evidence with others, by how much laws may err.
        some: indices of segments that it is fitted to; None for all.
    """
    problem, scored = before.problem, before.scored
    fitter, interval, noise = problem.fitter, problem.segments.interval, scored.residual_noise
    trajectory, known = scored.fit.trajectory, scored.system
    if some is not None:
        fitter, noise, trajectory = fitter.select(some), noise.select(some), trajectory[some]
        known = known.select(some)
    most_law_error = largest_law_error(scored.noise)
    hypothesis = scored.fit.hypothesis
    for effect, _ in added:
        hypothesis = hypothesis.with_effect(effect)
    theta = np.concatenate([scored.fit.theta, *(values for _, values in added)])
    fit = fitter.fit(hypothesis, theta, trajectory, noise, known=known)
    best, found = (fit, noise), list[float]()
    for number, largest in enumerate(_PAIR_LAW_ERRORS):
        if not np.isfinite(fit.log_evidence) or has_no_effect(added[-1][0], fit):
            break
        system, prior = fitter.system(hypothesis, fit.theta, fit.trajectory)
        noise = fit_process_force(system, prior, noise, interval, min(largest, most_law_error), largest)
        if has_windows_set_aside(before):
            windows = pushed_windows(fitter, fit, noise)
            noise = replace(noise, set_aside=noise.set_aside if windows is None else windows)
        fit = fitter.fit(hypothesis, fit.theta, fit.trajectory, noise, known=system)
        most = max(found, default=-np.inf)
        found.append(fit.log_evidence - least_worth(noise.set_aside, fitter.segments))
        if found[-1] > most:
            best = fit, noise
        elif largest == LARGEST_LAW_ERROR:
            break
        if number < len(leader) and number >= _LEAST_TRIED and found[-1] < leader[number] - _BEHIND_NATS:
            break
    return *best, found
