"""Predictions of held-out windows by the models of a search, and which of its effects they confirm."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wilcoxon

from slapshot.arrays import Array
from slapshot.diagnosis import held_out
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.held_out import HeldOutPush, Predictions
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.push_search import with_pushes
from slapshot.diagnosis.selection.steps import P_VALUE, Search, Step
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.external_pulse import ExternalPulse

_DISTINGUISHABLE_NATS = 2.0  # two standard deviations under noise
_EVENT = 25.0  # times the usual squares of the better of two models
_USUAL = 0.8  # of windows at least: where more are events, they are the motion, between times of rest
_AGREE = 0.1  # probability by which windows may agree by chance: four of four


@dataclass(frozen=True)
class Prediction:
    """One model's predictions of held-out windows.

    Attributes:
        hypothesis: effects.
        theta: their values.
        predictions: of the windows.
        noise: refitted to the other data under the model.
    """

    hypothesis: Hypothesis
    theta: Array
    predictions: Predictions
    noise: Noise


def predict_models(
    found: Search, problem: Problem, windows: Segments, seed: int, report: Callable[[str], None]
) -> tuple[Search, tuple[Prediction, Prediction, Prediction]]:
    """Predictions of the nominal, refitted and augmented model, each with its own noise.

    The search is truncated after the last step whose effect improves held-out predictions; pushes that came
    after it are looked for again.
    """
    known = dict[int, tuple[Step, Prediction]]()  # with the steps, so that no other has the same address

    def predicted(step: Step) -> Prediction:
        if id(step) not in known:
            theta = step.scored.fit.theta
            known[id(step)] = step, predict_windows(step, theta, problem, windows, fitted=True)
        return known[id(step)][1]

    first = found.nominal
    start = first.hypothesis.start
    nominal = refitted = predict_windows(first, start, problem, windows, fitted=False)
    if not np.array_equal(start, first.scored.fit.theta):
        refitted = predicted(first)
    last = refitted if found.final is first else predicted(found.final)
    found, last = _confirmed(found, refitted, last, predicted, report)
    if found.by_laws and _hidden(found.named) and not improves(refitted, last):
        report("the hidden state does not predict held-out windows better: laws instead")
        found = replace(found, steps=found.by_laws, by_laws=())
        found, last = _confirmed(found, refitted, predicted(found.final), predicted, report)
    if found.by_structure and not (found.named and found.final.test.p_value >= P_VALUE):
        found, last = _structure_or_laws(found, refitted, last, predicted, report)
    if any(isinstance(effect, ExternalPulse) for effect in found.dropped):
        again = with_pushes(found, seed, report)
        if again is not found:
            found, last = again, predicted(again.final)
    return found, (nominal, refitted, last)


def _structure_or_laws(
    found: Search,
    refitted: Prediction,
    last: Prediction,
    predicted: Callable[[Step], Prediction],
    report: Callable[[str], None],
) -> tuple[Search, Prediction]:
    """The hidden state that explained nearly as much, where it predicts better than laws, or none holds."""
    other = replace(found, steps=found.by_structure, by_structure=())
    try:
        other, structural = _confirmed(other, refitted, predicted(other.final), predicted, report)
    except np.linalg.LinAlgError:
        return found, last
    if not _hidden(other.named) or (found.named and not clearly_improves(last, structural)):
        return found, last
    report("the hidden state that explained nearly as much predicts held-out windows better")
    instead = tuple(effect for effect in found.named if effect.key not in {e.key for e in other.named})
    return replace(other, dropped=(*instead, *other.dropped)), structural


def _confirmed(
    found: Search,
    refitted: Prediction,
    last: Prediction,
    predicted: Callable[[Step], Prediction],
    report: Callable[[str], None],
) -> tuple[Search, Prediction]:
    """The search up to the last effect that improves held-out predictions, and its predictions.

    A push is a single event that held-out data cannot confirm: it is dropped only with an effect before it. A
    hidden state that has laws to take its place is compared with these.

    Args:
        found: all steps.
        refitted: predictions by the nominal model.
        last: predictions by the last step.
        predicted: predicts by a step.
        report: receives progress messages.
    """
    first = found.nominal
    kept, of_kept = found, last
    while laws := {effect.key for effect in found.named if not isinstance(effect, ExternalPulse)}:
        last_law = max(sorted(laws), key=found.first_with)
        number = found.first_with(last_law)
        by_law = [step for step in found.steps if step.added is not None and step.added.key == last_law]
        step = by_law[-1] if by_law else found.steps[number]
        less = replace(found, steps=found.steps[:number])
        if less.final is first and found.by_laws and _hidden(found.named):
            break
        before = refitted if less.final is first else predicted(less.final)
        after = last if step is found.final else predicted(step)
        if less.final is not first and not distinguishable(before.predictions, after.predictions):
            # It stays or goes with the one before it.
            found, last = less, before
            continue
        if improves(before, after):
            if improves(refitted, of_kept) or (found.by_laws and _hidden(found.named)):
                break
            # Better than the one before it, and still worse than none.
            less, before = replace(found, steps=found.steps[:1]), refitted
        stays = {effect.key for effect in less.named}
        since = [step.added for step in kept.steps[len(less.steps) :] if step.added is not None]
        order = [effect.key for effect in since]
        dropped = sorted(
            (effect for effect in kept.named if effect.key not in stays),
            key=lambda effect: order.index(effect.key) if effect.key in order else -1,
        )
        report(f"dropped {', '.join(e.key for e in dropped)}: it does not predict held-out windows better")
        found, last = replace(less, dropped=(*dropped, *kept.dropped)), before
        kept, of_kept = found, last
    return kept, of_kept


def _hidden(effects: Sequence[JointEffect]) -> bool:
    return any(effect.hidden_state for effect in effects)


def predict_windows(
    step: Step, theta: Array, nominal: Problem, windows: Segments, *, fitted: bool
) -> Prediction:
    """Predict held-out windows by the hypothesis of a step, with refitted noise.

    Args:
        step: of a search.
        theta: values of the hypothesis, not necessarily fitted.
        nominal: the problem of the nominal rig.
        windows: see `Diagnosis`.
        fitted: whether the values have the uncertainty of the step's fit; else they are exact.
    """
    fit, hypothesis = step.scored.fit, step.hypothesis
    trajectory = held_out.initial_trajectory(step.problem, nominal, windows)
    noise, _ = held_out.refitted_noise(step.problem, hypothesis, theta, fit.trajectory, step.scored.noise)
    precision = fit.precision if fitted else None
    predictions = held_out.predict(step.problem, hypothesis, theta, windows, noise, trajectory, precision)
    return Prediction(hypothesis, theta, predictions, noise)


def held_out_pushes(
    step: Step, refitted: Noise, nominal: Problem, segments: Segments, held: NDArray[np.intp]
) -> list[HeldOutPush]:
    """Pushes in held-out segments; none is looked for where the model has hidden states.

    Args:
        step: the last of a search.
        refitted: noise by which it predicted held-out windows.
        nominal: the problem of the nominal rig.
        segments: all.
        held: indices of those held out.
    """
    hypothesis, scored = step.hypothesis, step.scored
    if _hidden(hypothesis.effects):
        return []
    first = held_out.initial_trajectory(step.problem, nominal, segments)
    # Errors of laws elsewhere are not those that columns were fitted to: as a force, they are no pushes.
    noise = replace(scored.residual_noise, force=max(refitted.force, scored.residual_noise.force))
    try:
        return held_out.pushes_in(step.problem, hypothesis, scored.fit, segments, held, noise, first)
    except np.linalg.LinAlgError:
        return []  # the model diverges there, which errors of predictions show


def distinguishable(old: Predictions, new: Predictions) -> bool:
    """Whether held-out windows can distinguish two predictions, by readings and by likelihoods.

    A limit that is rarely reached may not have been reached in any window; and what forces of unknown cause
    blur, likelihoods do not tell apart.
    """
    return _differ(old, new) and not _as_likely(old, new)


def _as_likely(old: Predictions, new: Predictions) -> bool:
    return bool(abs(new.log_likelihood.sum() - old.log_likelihood.sum()) < _DISTINGUISHABLE_NATS)


def _differ(old: Predictions, new: Predictions) -> bool:
    """Whether readings with noise alone would distinguish two predictions.

    Half the squared difference, in units of the noise and with its correlation in time, is the expected gain
    of the better one, in nats.
    """
    shift = (new.predicted - old.predicted) / np.maximum(old.floor, 1e-12)
    there, gain = np.isfinite(old.error), 0.0
    for w, _, c in np.argwhere(there.any(axis=1, keepdims=True)):
        own = there[w, :, c]
        gain += float(
            shift[w, own, c] @ np.linalg.solve(old.correlation[c][np.ix_(own, own)], shift[w, own, c])
        )
    return gain / 2 > _DISTINGUISHABLE_NATS


def clearly_improves(before: Prediction, after: Prediction) -> bool:
    """Whether held-out likelihood and errors improve, and the windows can distinguish the two."""
    return distinguishable(before.predictions, after.predictions) and improves(before, after)


def improves(before: Prediction, after: Prediction) -> bool:
    """Whether held-out likelihood and errors improve, or the windows cannot distinguish the two.

    Where likelihoods cannot, errors must not grow in window after window.
    """
    old, new = before.predictions, after.predictions
    if not _differ(old, new):
        return True
    scale = np.maximum(old.floor.mean(axis=(0, 1)), 1e-12)
    squares = [np.nanmean((found.error / scale) ** 2, axis=(1, 2)) for found in (old, new)]
    if _as_likely(old, new):
        return not _windows_agree(squares[1], squares[0])
    # What neither model explains by far is an event, such as a push, and tells nothing of laws.
    least = np.minimum(*squares)
    usual = ~(least > _EVENT * np.nanmedian(least))
    if usual.mean() < _USUAL:
        usual[:] = True
    if np.nanmean(squares[1][usual]) >= np.nanmean(squares[0][usual]):
        return False
    likelier = new.log_likelihood[usual].sum() > old.log_likelihood[usual].sum()
    return bool(likelier or _windows_agree(*squares))


def _windows_agree(before: Array, after: Array) -> bool:
    """Whether errors shrink in window after window by more than chance (Wilcoxon's signed ranks of logs).

    Then the likelihood has no veto: it is that of the process force which a model was left with, and
    punishes the better model for the smaller one as soon as a window has something that no model has.
    """
    there = np.isfinite(before) & np.isfinite(after) & (before > 0) & (after > 0) & (before != after)
    if not there.any():
        return False
    shrunk = np.log(after[there] / before[there])
    return bool(wilcoxon(shrunk, alternative="less").pvalue < _AGREE)
