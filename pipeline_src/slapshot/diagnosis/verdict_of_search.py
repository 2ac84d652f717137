"""The verdict that a search and its predictions of held-out windows come to."""

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.noise import TYPICAL_DRIFT
from slapshot.diagnosis.held_out import HeldOutPush, Predictions
from slapshot.diagnosis.held_out_validation import Prediction, distinguishable
from slapshot.diagnosis.model.hypothesis import actuator_torque
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.free_forms import is_free
from slapshot.diagnosis.selection.recurrence import recurring_pushes
from slapshot.diagnosis.selection.steps import (
    EQUIVALENCE_NATS,
    P_VALUE,
    Search,
    Step,
    beside_law_errors,
)
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
from slapshot.effects.joints.effect import JointEffect, Observed, Parameter, State, overrides
from slapshot.effects.joints.external_pulse import ExternalPulse
from slapshot.recordings.signals import SignalRecording

MAX_REDUCED_CHI2 = (
    1.2  # mean square of held-out errors over what is expected, where something must be missing
)
_Z90, _ONE_SIDED_95 = 1.645, 1.645
_RESAMPLES = 1000


def verdict_of(
    recording: SignalRecording,
    rig: Rig,
    found: Search,
    windows: Segments,
    left_out: int,
    by_model: tuple[Prediction, Prediction, Prediction],
    segments: Segments,
    held: NDArray[np.intp],
    notes: list[str],
    pushed: Sequence[HeldOutPush],
    seed: int,
    began: float,
) -> Verdict:
    """The verdict, without versions.

    Args:
        recording: what was diagnosed.
        rig: nominal.
        found: steps of the search, of which those are kept that held-out windows confirm.
        windows: held-out segments, of which the second halves were predicted.
        left_out: further windows, in which something pushes.
        by_model: predictions by the model as it was given, refitted, and with what was found.
        segments: all.
        held: indices of those that are held out.
        notes: findings about the recording and the search.
        pushed: pushes in held-out data.
        seed: of the draws behind intervals.
        began: process time in s when the diagnosis began.
    """
    rng = np.random.default_rng([seed, 1])
    first, last = found.nominal, found.final
    p = first.test.p_value
    worse = [prediction.predictions.excess(rng)[0] > MAX_REDUCED_CHI2 for prediction in by_model[1:]]
    missing = p < P_VALUE or worse[0] or bool(pushed)
    named = found.named if missing else ()
    reason = "no test says that anything is missing"
    if named and not last.scored.fit.settled:
        notes = [
            *notes,
            "the fit with the named effects did not converge (values still moved by "
            f"{last.scored.fit.moved:.2g} standard deviations): their intervals may be too narrow",
        ]
    if named and not distinguishable(by_model[1].predictions, by_model[2].predictions):
        notes = [
            *notes,
            "the named effects are not observable in held-out windows: only the fit supports them",
        ]
    unexplained = last
    if named and last.test.p_value < P_VALUE:
        unexplained = beside_law_errors(last, np.random.default_rng([seed, 4]))
    left = unexplained.test.p_value
    # Laws that stand in for a hidden state may have been dropped before.
    kept = {effect.key for effect in named}
    dropped = [effect for effect in found.dropped if effect.key not in kept]
    notes = [*notes, *(_dropped_note(effect) for effect in dropped)]
    recurring = recurring_pushes(last, named, np.random.default_rng([seed, 3]))
    pushes = [effect for effect in named if isinstance(effect, ExternalPulse)]
    # Where pushes are named, those in held-out data are more of them.
    pushes_unnamed = bool(pushed) and not pushes
    only_pushes_left = pushes_unnamed and left >= P_VALUE and not worse[1] and recurring is None
    flagged = missing and (left < P_VALUE or worse[1] or not named or recurring is not None or pushes_unnamed)
    headline = "nothing_found"
    if missing:
        headline = "found" if named else "found_not_named"
        reason = (
            "the named effects explain the mismatch"
            if named and not flagged
            else "the named effects explain the mismatch but for pushes"
            if named and only_pushes_left
            else "the named effects leave a mismatch that no effect explains"
            if named
            else "something is missing, and no effect of the catalogue explains it"
            if p < P_VALUE
            else "held-out data show a mismatch that the fit does not, so that no effect was tried"
        )
        if named and recurring is not None:
            reason += f": {recurring}"
        elif flagged and worse[1] and (named or p < P_VALUE):
            reason += ": held-out prediction errors exceed noise and law errors"
        elif flagged and pushed and left >= P_VALUE:
            reason += ": something pushes in held-out data"
    units = [recording.channels[observation.channel].unit for observation in rig.observations]
    # A quantity may have been recorded in no held-out window.
    recorded = np.isfinite(by_model[0].predictions.error)
    kinds = {kind: c for kind, c in channel_groups(rig, units).items() if recorded[..., c].any()}
    unit_of = {kind: units[c[0]] for kind, c in kinds.items()}
    fits = [_errors(prediction.predictions, kinds, unit_of, rng) for prediction in by_model]
    if not named and missing:
        fits[2] = fits[1]
    scored = first.scored
    alone = scored.gains
    strongest = scored.effects[max(range(len(alone)), key=lambda i: alone[i].log_evidence)]
    location = _location(first) if missing else None
    if pushes and len(pushes) == len(named):
        # Scores and free forms know nothing of pushes, above all where their windows were set aside.
        strongest = pushes[0]
        location = Location(part=strongest.part, follows="time", size=None)
    unknown = recurring or _unknown(unexplained, last.test.p_value, dropped)
    if only_pushes_left:
        unknown = str(pushed[0])
    if pushed and p >= P_VALUE and not worse[0]:
        location = Location(part=pushed[0].joint, follows="time", size=None)
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
        mismatch=Mismatch(found=missing, p_value=p, strongest=_told(strongest)),
        location=location,
        effects=[_named_effect(found, effect, last) for effect in named],
        nominal_parameters=[_named_effect(found, effect, last) for effect in found.free],
        unknown=Unknown(flagged=flagged, p_value=left, description=unknown if flagged else ""),
        fit=Fits(
            nominal=fits[0],
            refitted=fits[1],
            augmented=fits[2],
            noise_floor=_floor(by_model[2].predictions, kinds, unit_of),
            window_s=windows.shape[1] // 2 * windows.interval,
            windows=windows.shape[0],
            windows_left_out=left_out,
        ),
        noise=_noise(recording, rig, last),
        limits=[] if missing else _limits(first),
        converged=last.scored.fit.converged,
        cpu_s=time.process_time() - began,
        versions={},
    )


def channel_groups(rig: Rig, units: Sequence[str]) -> dict[str, NDArray[np.intp]]:
    """Quantity -> columns of the observations; joints and bodies, and those in other units, apart.

    Args:
        rig: whose observations.
        units: of them.
    """
    kinds: dict[tuple[str, str], list[int]] = {}
    for c, (observation, unit) in enumerate(zip(rig.observations, units, strict=True)):
        of = "joint" if observation.dof is not None else "body"
        kinds.setdefault((f"{of} {observation.quantity}", unit), []).append(c)
    names = [kind for kind, _ in kinds]
    return {
        kind if names.count(kind) == 1 else f"{kind} in {unit or '1'}": np.array(columns)
        for (kind, unit), columns in kinds.items()
    }


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
    variant = f" {effect.variant}" if is_free(effect) and effect.variant else ""
    return effect.phrase.format(part=effect.part) + variant


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
    columns = scored.columns[best]
    precision = np.eye(len(columns)) + scored.eliminated.information[np.ix_(columns, columns)]
    size = _size(step, effect, found[best].values, np.asarray(np.linalg.inv(precision)))
    return Location(part=effect.part, follows=getattr(effect, "variable", "the motion"), size=size)


def _size(step: Step, effect: JointEffect, values: Array, covariance: Array) -> Interval | None:
    """Rms of a free form along the trajectory, with a 90 % interval to first order in its weights.

    Args:
        step: with the trajectory.
        effect: the form.
        values: (k,) of its weights, in units of their priors.
        covariance: (k, k) of these.
    """
    problem, fit = step.problem, step.scored.fit
    segments, model = problem.segments, problem.rig.model
    units = np.diag([parameter.scale for parameter in effect.parameters])
    x = fit.trajectory[segments.inside]
    order = np.repeat(segments.order[:, None], segments.shape[1], 1)[segments.inside]
    parts: list[Array | None]
    if overrides(effect, "force"):
        torque = actuator_torque(model, x, segments.control()[..., 0, :][segments.inside], problem.rig.load)
        state = State(
            x[:, : model.nq],
            x[:, model.nq : model.nq + model.nv],
            torque,
            segments.time[segments.inside],
            order,
        )
        parts = [effect.force(state, one) for one in units]
    else:
        y = problem.readings(segments, fit.trajectory)
        y, rate = y[segments.inside], segments.rate(y)[segments.inside]
        parts = [effect.observe(Observed(y, rate, 0 * y, order), one) for one in units]
    there = [part for part in parts if part is not None]
    if len(there) < len(parts):
        return None
    # The form is linear in its weights: its mean square is a quadratic form.
    along = np.stack([part.reshape(-1) for part in there])
    square = along @ along.T / len(x)
    rms = float(np.sqrt(values @ square @ values))
    slope = square @ values / max(rms, 1e-300)
    margin = _Z90 * float(np.sqrt(slope @ covariance @ slope))
    return Interval(value=rms, low=max(rms - margin, 0.0), high=rms + margin, unit=effect.parameters[0].unit)


def _dropped_note(effect: JointEffect) -> str:
    return f"{_told(effect)}: fitted, but held-out windows are not predicted better with it; not named"


def _told(effect: JointEffect) -> str:
    """Its phrase and variant: of pushes when they come, of readings which."""
    variant = f" ({effect.variant})" if effect.variant and not is_free(effect) else ""
    return _phrase(effect) + variant


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
    # Jitter, drift and growth below a tenth of the noise are not reported.
    shown = noise.rate is not None and bool(
        np.any(noise.jitter_s * np.sqrt(np.mean(noise.rate**2, axis=(0, 1))) > 0.1 * noise.single)
    )
    jitter = noise.jitter_s if shown else 0.0
    drifts = noise.drift > TYPICAL_DRIFT * (1 + 1e-6)  # which stays where there is but one episode
    growth = np.zeros_like(noise.white) if noise.growth is None else noise.growth
    growth = np.where(np.abs(growth) > 0.1, np.exp(growth), 1.0)
    drift = noise.drift * noise.single if drifts else np.zeros_like(noise.white)
    return {
        observation.channel: ChannelNoise(
            white=float(noise.white[c]),
            coloured=float(noise.coloured[c]),
            correlation_s=float(noise.correlation_s[c]),
            unit=recording.channels[observation.channel].unit,
            drift=float(drift[c]),
            jitter_s=jitter,
            growth=float(growth[c]),
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


def undecided(recording: SignalRecording, rig: Rig, notes: list[str], reason: str, began: float) -> Verdict:
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
