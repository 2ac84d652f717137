"""Diagnose a recording of joints and bodies: `diagnose(recording, rig)`.

A part of the recording is held out. On the rest the nominal model is fitted, tested, and extended by missing
effects, which are named only if they improve the prediction of the held-out part.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from threadpoolctl import threadpool_limits

from slapshot.diagnosis import held_out
from slapshot.diagnosis.fit.time_steps import prefers_its_steps, with_accurate_steps
from slapshot.diagnosis.held_out_split import held_out_windows, split, thinned
from slapshot.diagnosis.held_out_validation import Prediction, held_out_pushes, predict_models
from slapshot.diagnosis.impacts import without_impacts
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments, in_steps_of, segment_recording
from slapshot.diagnosis.selection.problem import Problem, initial_fit, noise_with_candidates
from slapshot.diagnosis.selection.search import search
from slapshot.diagnosis.selection.steps import Search, Step
from slapshot.diagnosis.verdict import Verdict
from slapshot.diagnosis.verdict_of_search import undecided, verdict_of
from slapshot.effects.joints.catalogue import instances
from slapshot.effects.joints.effect import Joint, JointEffect
from slapshot.errors import InputError
from slapshot.recordings.channel_pair_quality import differentiated_velocities
from slapshot.recordings.position_quality import whole_turns
from slapshot.recordings.signal_statistics import channel_statistics
from slapshot.recordings.signals import SignalRecording

# Of a joint that moves: its travel in rad or m, or in standard deviations of an encoder that sees less.
_TRAVEL, _OVER_NOISE = 2e-3, 100.0
# Of held-out windows: least share without pushes that is predicted alone, and rounds of finding these.
_LEAST_QUIET, _PUSH_ROUNDS = 0.5, 3
_MEMORY = 3e9  # bytes, of derivatives and scores; several times as much is in use at once


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
    recording, cuts = without_impacts(recording, rig)
    measured = [channel_statistics(recording, o.channel) for o in rig.observations]
    derived = differentiated_velocities(measured)
    measured = [one for one in measured if one.name not in derived]
    rig = rig.without(derived)
    notes = [*findings, *cuts, *_undriven_inputs(rig)]
    if derived:
        notes.append(f"{', '.join(derived)} were differentiated from recorded positions and are not used")
    for observation, one in zip(rig.observations, measured, strict=True):
        if observation.dof is not None and observation.quantity == "position" and (count := whole_turns(one)):
            wraps = (
                f"{observation.channel} jumps by a whole turn, {count} times: the angle wraps; unwrap it "
                "(period in a mapping, or numpy.unwrap)"
            )
            return Diagnosis(undecided(recording, rig, notes, wraps, began), rig)
    channels = {name: channel for name, channel in recording.channels.items() if name not in derived}
    try:
        segments = segment_recording(recording, rig)
        used, held = split(segments)
        problem = Problem.of(rig, channels, used, threads)
        if used.shape[0] > (most := max(1, int(_MEMORY / problem.memory_per_segment))):
            some = thinned(used, most)
            notes.append(
                f"of {used.shape[0]} segments {some.shape[0]} were fitted, spread over the recording: for "
                "all, the derivatives by everything that may be missing take too much memory"
            )
            problem = Problem.of(rig, channels, some, threads)
        if (accurate := _accurate_problem(problem, recording)) is not None:
            problem, told = accurate
            rig, notes = problem.rig, [*notes, told]
            segments = in_steps_of(rig, recording, segments)
        free = free_effects(rig, problem)
    except InputError as error:
        return Diagnosis(undecided(recording, rig, notes, str(error), began), rig)
    reason = _insufficiency_reason(problem)
    if reason is None:
        try:
            searched = search(problem, free, seed, report)
            reason = _fit_failure(searched)
        except np.linalg.LinAlgError:
            reason = (
                "the nominal model diverges from the recorded motion at once; check units and signs of the "
                "controls, and whether the model is that of this robot"
            )
    if reason is not None:
        return Diagnosis(undecided(recording, rig, notes, reason, began), rig)
    report("predicting held-out windows")
    windows = held_out_windows(recording, rig, segments, held)
    if not windows.shape[0]:
        reason = "no held-out part is long enough to predict its second half; record longer episodes"
        return Diagnosis(undecided(recording, rig, notes, reason, began), rig)
    windows, wrong = _readings_of(windows, searched.nominal)
    notes += wrong
    everything, quiet = windows, np.ones(windows.shape[0], bool)
    for _ in range(_PUSH_ROUNDS):
        windows = everything.select(quiet)
        found, by_model, said = _predicted(searched, problem, windows, seed, report)
        pushed = held_out_pushes(found.final, by_model[2].noise, problem, segments, held)
        # A push that no model has tells nothing of laws, and what is named may leave other ones.
        before, quiet = quiet, ~held_out.windows_with(pushed, everything)
        if quiet.mean() < _LEAST_QUIET:
            quiet[:] = True
        if np.array_equal(quiet, before):
            break
        report("predicting held-out windows in which nothing pushes")
    else:
        # Where rounds do not agree, none is left out.
        windows = everything
        found, by_model, said = _predicted(searched, problem, windows, seed, report)
        pushed = held_out_pushes(found.final, by_model[2].noise, problem, segments, held)
    notes += [*said, *(str(push) for push in pushed)]
    left_out = everything.shape[0] - windows.shape[0]
    verdict = verdict_of(
        recording, rig, found, windows, left_out, by_model, segments, held, notes, pushed, seed, began
    )
    return Diagnosis(verdict, rig, found, windows, *by_model)


def _accurate_problem(problem: Problem, recording: SignalRecording) -> tuple[Problem, str] | None:
    """The problem with accurate time steps, and what is said of them; None where its own serve."""
    noise = problem.initial_noise.single
    segments, trajectory = problem.segments, problem.trajectory
    found = with_accurate_steps(problem.rig, problem.channels, recording, segments, trajectory, noise)
    if found is None:
        return None
    try:
        problem, fit, first = initial_fit(problem, problem.base(()))
        seen = noise_with_candidates(problem, fit.hypothesis, fit.theta, fit.trajectory, first)
    except np.linalg.LinAlgError:
        return None  # the model diverges, of which the search says so
    system, prior = seen.explaining
    if prefers_its_steps(system, prior, seen.noise, problem.segments.interval, len(fit.theta)):
        return None
    rig, told = found
    segments = in_steps_of(rig, recording, segments)
    return Problem.of(rig, problem.channels, segments, problem.threads), told


def _predicted(
    found: Search, problem: Problem, windows: Segments, seed: int, report: Callable[[str], None]
) -> tuple[Search, tuple[Prediction, Prediction, Prediction], list[str]]:
    """What held-out windows confirm of a search, predictions, and what is said of them."""
    try:
        return *predict_models(found, problem, windows, seed, report), []
    except np.linalg.LinAlgError:
        told = ["with what was found, predictions of held-out windows diverge: none of it is named"]
        found = Search((found.nominal,), found.free)
        return *predict_models(found, problem, windows, seed, report), told


def _readings_of(windows: Segments, nominal: Step) -> tuple[Segments, list[str]]:
    """Windows without wrong readings, and what is said of these."""
    scored, hypothesis = nominal.scored, nominal.hypothesis
    try:
        right = held_out.without_wrong_readings(
            nominal.problem, hypothesis, scored.fit.theta, windows, scored.residual_noise
        )
    except np.linalg.LinAlgError:
        return windows, []  # the nominal model diverges there: nothing can be judged by it
    count = int((np.isfinite(windows.y) & ~np.isfinite(right.y)).sum())
    told = f"{count} readings of held-out data are no motion, whatever force acts: predictions leave them out"
    return right, [told] if count else []


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
    noise = {
        observation.dof: problem.initial_noise.single[column]
        for column, observation in enumerate(problem.rig.observations)
        if observation.quantity == "position"
    }

    def moves(joint: Joint) -> bool:
        travel = np.std(problem.trajectory[problem.segments.inside][:, joint.q])
        least = _TRAVEL * max(1.0, abs(joint.middle))
        return bool(travel > min(least, _OVER_NOISE * noise.get(joint.v, np.inf)))

    moving = any(moves(joint) for joint in problem.rig_motion.joints)
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
