"""Diagnose a recording of joints and bodies: `diagnose(recording, rig)`.

A part of the recording is held out. On the rest the nominal model is fitted, tested, and extended by missing
effects, which are named only if they improve the prediction of the held-out part.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.stats import wilcoxon
from threadpoolctl import threadpool_limits

from slapshot.arrays import Array
from slapshot.diagnosis import held_out
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.held_out import HeldOutPush, Predictions
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.diagnosis.selection.free_forms import is_free
from slapshot.diagnosis.selection.problem import Problem
from slapshot.diagnosis.selection.push_search import with_pushes
from slapshot.diagnosis.selection.search import search
from slapshot.diagnosis.selection.steps import EQUIVALENCE_NATS, P_VALUE, Search, Step
from slapshot.diagnosis.verdict import (
    ChannelNoise,
    Errors,
    Fits,
    Interval,
    Limit,
    Location,
    Mismatch,
    NamedEffect,
    NamedParameter,
    Unknown,
    Verdict,
)
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import JointEffect, Observed, Parameter, State, overrides
from slapshot.effects.joints.external_pulse import ExternalPulse
from slapshot.errors import InputError
from slapshot.recordings.channel_pair_quality import differentiated_velocities
from slapshot.recordings.signal_statistics import channel_statistics
from slapshot.recordings.signals import SignalRecording

MAX_REDUCED_CHI2 = (
    1.2  # mean square of held-out errors over what is expected, where something must be missing
)
HELD_OUT = 5  # every fifth episode or block
_MIN_SEGMENTS = 5
_MIN_COVERAGE = 0.75  # share of two windows that must have been recorded
_Z90, _ONE_SIDED_95 = 1.645, 1.645
_RESAMPLES = 1000
# Pushes in a larger share of at least this many episodes are not events but systematic.
_MAX_PUSHED_SHARE, _MIN_EPISODES = 0.5, 4
_DISTINGUISHABLE_NATS = 2.0  # two standard deviations under noise
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


@dataclass(frozen=True)
class Diagnosis:
    """A verdict and the results behind it.

    Attributes:
        verdict: without versions.
        rig: nominal.
        search: None where nothing could be fitted.
        windows: held-out segments, of which the second halves were predicted.
        nominal: predictions of them by the model as it was given.
        refitted: by that with its free parameters fitted.
        augmented: by that with the named effects.
    """

    verdict: Verdict
    rig: Rig
    search: Search | None = None
    windows: Segments | None = None
    nominal: Prediction | None = None
    refitted: Prediction | None = None
    augmented: Prediction | None = None


def diagnose(
    recording: SignalRecording,
    rig: Rig,
    *,
    seed: int = 0,
    threads: int = 1,
    findings: Sequence[str] = (),
    report: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Diagnose which physics a model lacks, from a recording.

    Args:
        recording: checked.
        rig: the model, with the recording's channels bound to it.
        seed: of the draws behind p-values and intervals.
        threads: for simulation; the result does not depend on them.
        findings: quality warnings about the recording.
        report: receives progress messages.

    Returns:
        A verdict; where the data are insufficient, its headline is cannot_tell.
    """
    # Matrices are small: multi-threaded linear algebra takes twice the CPU time and saves none.
    with threadpool_limits(1):
        return _diagnosis(recording, rig, seed, threads, findings, report)


def _diagnosis(
    recording: SignalRecording,
    rig: Rig,
    seed: int,
    threads: int,
    findings: Sequence[str],
    report: Callable[[str], None],
) -> Diagnosis:
    began = time.process_time()
    # Fits try unstable models; MuJoCo's warnings about them are suppressed.
    mujoco.set_mju_user_warning(lambda text: None)
    derived = differentiated_velocities([channel_statistics(recording, o.channel) for o in rig.observations])
    rig = rig.without(derived)
    notes = [*findings, *_undriven_inputs(rig)]
    if derived:
        notes.append(f"{', '.join(derived)} were differentiated from recorded positions and are not used")
    channels = {name: channel for name, channel in recording.channels.items() if name not in derived}
    try:
        segments = segment_recording(recording, rig)
        used, held = split(segments)
        problem = Problem.of(rig, channels, used, threads)
        free = free_effects(rig, problem)
    except InputError as error:
        return Diagnosis(_undecided(recording, rig, notes, str(error), began), rig)
    reason = _insufficiency_reason(problem)
    if reason is None:
        try:
            found = search(problem, free, seed, report)
            reason = _fit_failure(found)
        except np.linalg.LinAlgError:
            reason = (
                "the nominal model diverges from the recorded motion at once; check units and signs of the "
                "controls, and whether the model is that of this robot"
            )
    if reason is not None:
        return Diagnosis(_undecided(recording, rig, notes, reason, began), rig)
    report("predicting held-out windows")
    windows = _windows(recording, rig, segments, held)
    if not windows.shape[0]:
        reason = "no held-out part is long enough to predict its second half; record longer episodes"
        return Diagnosis(_undecided(recording, rig, notes, reason, began), rig)
    found, by_model = _predict_models(found, problem, windows, seed, report)
    pushed = _held_out_pushes(found.final, by_model[2].noise, problem, segments, held)
    notes += [str(push) for push in pushed]
    verdict = _verdict(recording, rig, found, windows, by_model, segments, held, notes, pushed, seed, began)
    return Diagnosis(verdict, rig, found, windows, *by_model)


def split(segments: Segments) -> tuple[Segments, NDArray[np.intp]]:
    """Split segments into those for fitting and those held out.

    Returns:
        The segments, and indices of those that are held out.
    """
    episodes = len(np.unique(segments.episode))
    S = segments.shape[0]
    if episodes >= HELD_OUT:
        out = segments.episode % HELD_OUT == HELD_OUT // 2
    else:
        out = np.arange(S) % (2 * HELD_OUT) // 2 == HELD_OUT // 2  # two segments side by side
    if S < _MIN_SEGMENTS or not out.any():
        raise InputError(
            f"only {S} segments of {segments.interval * segments.shape[1]:.2g} s were recorded, of which "
            "some must be held out; record longer"
        )
    return segments.select(~out), np.flatnonzero(out)


def free_effects(rig: Rig, problem: Problem) -> tuple[JointEffect, ...]:
    """The effects that the rig file declares free in the nominal model.

    Raises:
        InputError: one is none of the catalogue.
    """
    found: list[JointEffect] = []
    for wanted in rig.free:
        own = [e for e in instances(problem.rig_motion) if wanted in (e.name, e.key, f"{e.name}@{e.part}")]
        own = [e for e in own if not e.hidden_state and not e.many_forms]
        if not own:
            keys = sorted({e.name for e in instances(problem.rig_motion) if not e.hidden_state})
            raise InputError(
                f"free: {wanted!r} is no parameter of this model; use some of: {', '.join(keys)}"
            )
        seen: set[tuple[str, str]] = set()
        for effect in own:
            if (effect.name, effect.part) not in seen:
                seen.add((effect.name, effect.part))
                found.append(effect)
    return tuple(found)


def _undriven_inputs(rig: Rig) -> list[str]:
    return [
        f"input {control.input} has no recorded control; {control.rest:.4g} is used"
        for control in rig.controls
        if control.channel is None
    ]


def _insufficiency_reason(problem: Problem) -> str | None:
    """Why the motion is insufficient for identification; None if it is sufficient."""
    moving = [j for j in problem.rig_motion.joints if j.travel > 2e-3 * max(1.0, abs(j.middle))]
    if problem.rig_motion.joints and not moving and not problem.rig_motion.free_bodies:
        return "no joint moves by more than a few thousandths of a rad or m; record larger motions"
    return None


def _fit_failure(found: Search) -> str | None:
    """Why the nominal fit failed; None if it succeeded."""
    fit = found.nominal.scored.fit
    if not np.all(np.isfinite(fit.trajectory)) or not np.isfinite(fit.log_evidence):
        return (
            "the nominal model diverges from the recorded motion; check units and signs of the controls, and "
            "whether the model is that of this robot"
        )
    if not fit.settled:
        return (
            "the fit of the nominal model's free parameters does not converge (they still moved by "
            f"{fit.moved:.2g} standard deviations); free fewer, or record motions that distinguish them"
        )
    return None


def _windows(recording: SignalRecording, rig: Rig, segments: Segments, held: NDArray[np.intp]) -> Segments:
    """Held-out data as pairs of windows, the second of which is predicted.

    Of episodes that are shorter than two windows, windows are half as long as the episodes.
    """
    L = segments.shape[1]
    own = segments.select(held)
    lengths = [own.inside[run].sum() * segments.interval for run in own.runs()]
    window_s = min(held_out.WINDOW_S, float(np.median(lengths)) / 2)
    whole = segment_recording(recording, rig, segment_s=2 * window_s)
    wanted = np.zeros((len(segments.controls), int(whole.first.max()) + whole.shape[1] + L), bool)
    for k in held:
        first = segments.first[k]
        wanted[segments.episode[k], first : first + int(segments.inside[k].sum())] = True
    keep = []
    for k in range(whole.shape[0]):
        nodes, first = int(whole.inside[k].sum()), whole.first[k]
        there = wanted[whole.episode[k], first : first + nodes]
        keep.append(bool(there.all()) and nodes > _MIN_COVERAGE * whole.shape[1])
    return whole.select(np.array(keep, bool))


def _predict_models(
    found: Search, problem: Problem, windows: Segments, seed: int, report: Callable[[str], None]
) -> tuple[Search, tuple[Prediction, Prediction, Prediction]]:
    """Predictions of the nominal, refitted and augmented model, each with its own noise.

    The search is truncated after the last step whose effect improves held-out predictions; pushes that came
    after it are looked for again.
    """

    def predicted(step: Step, theta: Array, fitted: bool = True) -> Prediction:
        return predict_windows(step, theta, problem, windows, fitted=fitted)

    first = found.nominal
    start, theta = first.hypothesis.start, first.scored.fit.theta
    nominal = refitted = predicted(first, start, fitted=False)
    if not np.array_equal(start, theta):
        refitted = predicted(first, theta)
    last = refitted if len(found.steps) == 1 else predicted(found.final, found.final.scored.fit.theta)
    while len(found.named) > 1:
        # A push is a single event that held-out data cannot confirm: it is dropped only with a law before it.
        laws = {effect.key for effect in found.named if not isinstance(effect, ExternalPulse)}
        of_laws = [step for step in found.steps if step.added is not None and step.added.key in laws]
        step = of_laws[-1] if of_laws else first
        if step is first or found.before(step.added).final is first:
            break
        less = found.before(step.added)
        before = predicted(less.final, less.final.scored.fit.theta)
        after = last if step is found.final else predicted(step, step.scored.fit.theta)
        if _improves(before, after):
            break
        named = {effect.key for effect in found.named}
        dropped = [effect for effect in found.since(step.added) if effect.key in named]
        report(f"dropped {', '.join(e.key for e in dropped)}: it does not predict held-out windows better")
        found, last = replace(less, dropped=(*dropped, *found.dropped)), before
    if any(isinstance(effect, ExternalPulse) for effect in found.dropped):
        again = with_pushes(found, seed, report)
        if again is not found:
            found, last = again, predicted(again.final, again.final.scored.fit.theta)
    hidden = any(effect.hidden_state for effect in found.named)
    if hidden and found.by_laws and not _improves(refitted, last):
        report("the hidden state does not predict held-out windows better: laws instead")
        found = replace(found, steps=found.by_laws, by_laws=())
        last = predicted(found.final, found.final.scored.fit.theta)
    return found, (nominal, refitted, last)


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


def _held_out_pushes(
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
    if any(effect.hidden_state for effect in hypothesis.effects):
        return []
    first = held_out.initial_trajectory(step.problem, nominal, segments)
    # Errors of laws elsewhere are not those that columns were fitted to: as a force, they are no pushes.
    noise = replace(scored.residual_noise, force=max(refitted.force, scored.residual_noise.force))
    try:
        return held_out.pushes_in(step.problem, hypothesis, scored.fit, segments, held, noise, first)
    except np.linalg.LinAlgError:
        return []  # the model diverges there, which errors of predictions show


def _verdict(
    recording: SignalRecording,
    rig: Rig,
    found: Search,
    windows: Segments,
    by_model: tuple[Prediction, Prediction, Prediction],
    segments: Segments,
    held: NDArray[np.intp],
    notes: list[str],
    pushed: Sequence[HeldOutPush],
    seed: int,
    began: float,
) -> Verdict:
    rng = np.random.default_rng([seed, 1])
    first, last = found.nominal, found.final
    p = first.test.p_value
    worse = [prediction.predictions.excess(rng)[0] > MAX_REDUCED_CHI2 for prediction in by_model[1:]]
    missing = p < P_VALUE or worse[0] or bool(pushed)
    named = found.named if missing else ()
    reason = "no test says that anything is missing"
    held_up = True
    if named:
        held_up = all(isinstance(e, ExternalPulse) for e in named) or _improves(*by_model[1:])
        if not held_up:
            notes = [*notes, "the found effects do not improve held-out predictions, so none is named"]
            named = ()
    if named and not distinguishable(by_model[1].predictions, by_model[2].predictions):
        notes = [
            *notes,
            "the named effects are not observable in held-out windows: only the fit supports them",
        ]
    left = last.test.p_value
    # Laws that stand in for a hidden state may have been dropped before.
    kept = {effect.key for effect in named}
    dropped = [effect for effect in found.dropped if effect.key not in kept]
    notes = [*notes, *(_dropped_note(effect) for effect in dropped)]
    recurring = _recurring_pushes(last, named)
    flagged = missing and (left < P_VALUE or worse[1] or not named or recurring is not None)
    headline = "nothing_found"
    if missing:
        headline = "found" if named else "found_not_named"
        reason = (
            "the named effects explain the mismatch"
            if named and not flagged
            else "the named effects leave a mismatch that no effect explains"
            if named
            else "something is missing, and no effect of the catalogue explains it"
        )
        if named and recurring is not None:
            reason += f": {recurring}"
        elif flagged and worse[1]:
            reason += ": held-out prediction errors exceed noise and law errors"
        elif flagged and pushed and left >= P_VALUE:
            reason += ": something pushes in held-out data"
    kinds = channel_groups(rig)
    units = {kind: recording.channels[rig.observations[c[0]].channel].unit for kind, c in kinds.items()}
    fits = [_errors(prediction.predictions, kinds, units, rng) for prediction in by_model]
    if not named and missing:
        fits[2] = fits[1]
    scored = first.scored
    alone = scored.gains
    strongest = scored.effects[max(range(len(alone)), key=lambda i: alone[i].log_evidence)]
    location = _location(first) if missing else None
    pushes = [effect for effect in named if isinstance(effect, ExternalPulse)]
    if pushes and len(pushes) == len(named):
        # Scores and free forms know nothing of pushes, above all where their windows were set aside.
        strongest = pushes[0]
        location = Location(part=strongest.part, follows="time", size=None)
    unknown = recurring or _unknown(last, left, dropped)
    if pushed and p >= P_VALUE and not worse[0]:
        location, unknown = Location(part=pushed[0].joint, follows="time", size=None), str(pushed[0])
    return Verdict(
        headline=headline,  # type: ignore[arg-type]
        reason=reason,
        rig=recording.rig,
        stand_in=recording.stand_in,
        episodes=len(recording.episodes),
        seconds=float(segments.inside.sum() * segments.interval),
        held_out_episodes=sorted({int(segments.ids[segments.episode[k]]) for k in held}),
        cannot_tell=None,
        findings=notes,
        mismatch=Mismatch(found=missing, p_value=p, strongest=_phrase(strongest)),
        location=location,
        effects=[_named_effect(found, effect, last) for effect in named],
        nominal_parameters=[_named_effect(found, effect, last) for effect in found.free],
        unknown=Unknown(flagged=flagged, p_value=left, description=unknown if flagged else ""),
        fit=Fits(
            nominal=fits[0],
            refitted=fits[1],
            augmented=fits[2],
            noise_floor=_floor(by_model[2].predictions, kinds, units),
            window_s=windows.shape[1] // 2 * windows.interval,
        ),
        noise=_noise(recording, rig, last),
        limits=[] if missing else _limits(first),
        converged=last.scored.fit.converged,
        cpu_s=time.process_time() - began,
        versions={},
    )


def channel_groups(rig: Rig) -> dict[str, NDArray[np.intp]]:
    """Quantity -> columns of the observations; joints and bodies apart."""
    kinds: dict[str, list[int]] = {}
    for c, observation in enumerate(rig.observations):
        of = "joint" if observation.dof is not None else "body"
        kinds.setdefault(f"{of} {observation.quantity}", []).append(c)
    return {kind: np.array(columns) for kind, columns in kinds.items()}


def distinguishable(old: Predictions, new: Predictions) -> bool:
    """Whether held-out windows can distinguish two predictions, assuming white noise.

    Half the squared difference over the noise is the expected gain of the better one, in nats. A limit that
    is rarely reached may not have been reached in any window.
    """
    shift = (new.predicted - old.predicted) / np.maximum(old.floor, 1e-12)
    return bool(np.sum(shift[np.isfinite(old.error)] ** 2) / 2 > _DISTINGUISHABLE_NATS)


def _improves(before: Prediction, after: Prediction) -> bool:
    """Whether held-out likelihood and errors improve, or the windows cannot distinguish the two."""
    old, new = before.predictions, after.predictions
    if not distinguishable(old, new):
        return True
    scale = np.maximum(old.floor.mean(axis=(0, 1)), 1e-12)
    squares = [np.nanmean((found.error / scale) ** 2, axis=(1, 2)) for found in (old, new)]
    if np.nanmean(squares[1]) >= np.nanmean(squares[0]):
        return False
    return bool(new.log_likelihood.sum() > old.log_likelihood.sum() or _windows_agree(*squares))


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


def _errors(
    found: Predictions, kinds: dict[str, NDArray[np.intp]], units: dict[str, str], rng: np.random.Generator
) -> Errors:
    rms = {}
    for kind, columns in kinds.items():
        squares = found.squares(columns)
        squares = squares[np.isfinite(squares)]
        picks = rng.integers(0, len(squares), (_RESAMPLES, len(squares)))
        low, high = np.quantile(np.sqrt(squares[picks].mean(1)), [0.05, 0.95])
        value = float(np.sqrt(squares.mean()))
        rms[kind] = Interval(
            value=value, low=min(float(low), value), high=max(float(high), value), unit=units[kind]
        )
    return Errors(rms=rms, log_likelihood=float(found.log_likelihood.mean()))


def _floor(found: Predictions, kinds: dict[str, NDArray[np.intp]], units: dict[str, str]) -> Errors:
    rms = {}
    for kind, columns in kinds.items():
        value = found.rms_floor(columns)
        rms[kind] = Interval(value=value, low=value, high=value, unit=units[kind])
    return Errors(rms=rms, log_likelihood=None)


def _named_effect(found: Search, effect: JointEffect, last: Step) -> NamedEffect:
    fit = last.scored.fit
    index = next(i for i, e in enumerate(fit.hypothesis.effects) if e.key == effect.key)
    part = fit.hypothesis.slices[index]
    sd = fit.sd
    parameters = [
        estimated_parameter(parameter, float(fit.theta[k]), float(sd[k]))
        for k, parameter in zip(range(part.start, part.stop), effect.parameters, strict=True)
    ]
    step = next((s for s in found.steps if s.added is not None and s.added.key == effect.key), None)
    rivals = {}
    if step is not None:
        for rival in step.rivals:
            if rival.effect.key != effect.key and step.gain - rival.gain < EQUIVALENCE_NATS:
                rivals[rival.effect.key] = step.gain - rival.gain
    return NamedEffect(
        name=effect.name,
        part=effect.part,
        variant=effect.variant,
        phrase=_phrase(effect),
        gain_nats=step.gain if step is not None else 0.0,
        rivals=rivals,
        same_as=effect.same_as(fit.theta[part]),
        parameters=parameters,
    )


def estimated_parameter(parameter: Parameter, value: float, sd: float) -> NamedParameter:
    """A fitted value with its 90 % interval."""
    low, high = max(value - _Z90 * sd, parameter.low), min(value + _Z90 * sd, parameter.high)
    bound = value in (parameter.low, parameter.high)
    flat = sd > 0.7 * parameter.scale
    return NamedParameter(
        name=parameter.name,
        value=value,
        low=min(low, value),
        high=max(high, value),
        unit=parameter.unit,
        state="at a bound" if bound else "flat" if flat else "moved",
    )


def _phrase(effect: JointEffect) -> str:
    return effect.phrase.format(part=effect.part) + (f" {effect.variant}" if is_free(effect) else "")


def _location(step: Step) -> Location:
    """Location of the mismatch: part and variable of the free form with the largest gain."""
    scored = step.scored
    found = scored.gains
    free = [i for i, effect in enumerate(scored.effects) if is_free(effect)]
    if not free:
        effect = scored.effects[step.test.largest]
        return Location(part=effect.part, follows="the whole motion", size=None)
    best = max(free, key=lambda i: found[i].log_evidence)
    effect = scored.effects[best]
    size = _size(step, effect, found[best].values)
    return Location(part=effect.part, follows=getattr(effect, "variable", "the motion"), size=size)


def _size(step: Step, effect: JointEffect, values: Array) -> Interval | None:
    """Rms of a free form along the trajectory."""
    problem, fit = step.problem, step.scored.fit
    segments, model = problem.segments, problem.rig.model
    weights = values * np.array([parameter.scale for parameter in effect.parameters])
    x = fit.trajectory[segments.inside]
    order = np.repeat(segments.order[:, None], segments.shape[1], 1)[segments.inside]
    unit = effect.parameters[0].unit
    if overrides(effect, "force"):
        zeros = np.zeros((len(x), model.nv))
        state = State(
            x[:, : model.nq],
            x[:, model.nq : model.nq + model.nv],
            zeros,
            segments.time[segments.inside],
            order,
        )
        change = effect.force(state, weights)
    else:
        y = np.nan_to_num(segments.y[segments.inside])
        rate = problem.rates(segments, fit.trajectory)[segments.inside]
        change = effect.observe(Observed(y, rate, 0 * y, order), weights)
    if change is None:
        return None
    rms = float(np.sqrt(np.mean(np.sum(change**2, axis=1))))
    return Interval(value=rms, low=rms, high=rms, unit=unit)


def _recurring_pushes(step: Step, named: Sequence[JointEffect]) -> str | None:
    """A message if pushes occur in most episodes; None otherwise."""
    segments = step.problem.segments
    episodes = len(np.unique(segments.episode))
    pushed = len(
        {pulse.order for effect in named if isinstance(effect, ExternalPulse) for pulse in effect.pulses}
    )
    if episodes < _MIN_EPISODES or pushed <= _MAX_PUSHED_SHARE * episodes:
        return None
    return f"pushes come in {pushed} of {episodes} episodes, with a cause that no named effect explains"


def _dropped_note(effect: JointEffect) -> str:
    return f"{_told(effect)}: fitted, but held-out windows are not predicted better with it; not named"


def _told(effect: JointEffect) -> str:
    """Its phrase, and of pushes when they come."""
    when = f" ({effect.variant})" if isinstance(effect, ExternalPulse) else ""
    return _phrase(effect) + when


def _unknown(step: Step, p_value: float, dropped: Sequence[JointEffect] = ()) -> str:
    pushes = [_told(effect) for effect in dropped if isinstance(effect, ExternalPulse)]
    if pushes:
        return f"beside laws that do not hold it looked like {' and '.join(pushes)}"
    scored = step.scored
    found = scored.gains
    free = [i for i, effect in enumerate(scored.effects) if is_free(effect)]
    seen = "" if p_value < P_VALUE else "seen in held-out windows only; "
    if not free:
        return f"{seen}no free form describes it"
    best = max(free, key=lambda i: found[i].log_evidence)
    return f"{seen}best described as {_phrase(scored.effects[best])}"


def _noise(recording: SignalRecording, rig: Rig, step: Step) -> dict[str, ChannelNoise]:
    noise = step.scored.noise
    # Jitter and drift below a tenth of the noise are reported as zero.
    shown = noise.rate is not None and bool(
        np.any(noise.jitter_s * np.sqrt(np.mean(noise.rate**2, axis=(0, 1))) > 0.1 * noise.white)
    )
    jitter = noise.jitter_s if shown else 0.0
    drift = noise.drift * noise.single if noise.drift > 0.1 else np.zeros_like(noise.white)
    return {
        observation.channel: ChannelNoise(
            white=float(noise.white[c]),
            coloured=float(noise.coloured[c]),
            correlation_s=float(noise.correlation_s[c]),
            unit=recording.channels[observation.channel].unit,
            drift=float(drift[c]),
            jitter_s=jitter,
        )
        for c, observation in enumerate(rig.observations)
    }


def _limits(step: Step) -> list[Limit]:
    """Upper limit of each effect by itself, at 95 %."""
    scored = step.scored
    total, information = scored.eliminated.total, scored.eliminated.information
    limits = []
    for effect, columns in zip(scored.effects, scored.columns, strict=True):
        if is_free(effect) or effect.many_forms or len(columns) > len(effect.parameters):
            continue
        precision = np.eye(len(columns)) + information[np.ix_(columns, columns)]
        covariance = np.linalg.inv(precision)
        values = covariance @ total[columns]
        for k, c in enumerate(columns):
            perturbation = scored.perturbations[c]
            start = [parameter.start for parameter in effect.parameters]
            which = int(np.argmax(np.abs(np.array(perturbation.values) - start)))
            limit = (abs(values[k]) + _ONE_SIDED_95 * float(np.sqrt(covariance[k, k]))) * perturbation.scale
            parameter = effect.parameters[which]
            limits.append(
                Limit(effect=effect.key, parameter=parameter.name, limit=limit, unit=parameter.unit)
            )
    return limits


def _undecided(recording: SignalRecording, rig: Rig, notes: list[str], reason: str, began: float) -> Verdict:
    """A cannot_tell verdict with its reason."""
    return Verdict(
        headline="cannot_tell",
        reason=reason,
        rig=recording.rig,
        stand_in=recording.stand_in,
        episodes=len(recording.episodes),
        seconds=0.0,
        held_out_episodes=[],
        cannot_tell=reason,
        findings=notes,
        mismatch=None,
        location=None,
        effects=[],
        nominal_parameters=[],
        unknown=None,
        fit=None,
        noise={},
        limits=[],
        converged=False,
        cpu_s=time.process_time() - began,
        versions={},
    )
