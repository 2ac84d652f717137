"""Steps that add pushes from outside, and the windows that are set aside for them.

Where enormous forces act in a few windows, these are set aside while laws are found: their further process
force keeps them from spoiling the fit. Then they are named as pushes, if they are worth it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.fit import Fit, Fitter
from slapshot.diagnosis.fit.noise import Noise, fit_process_force, posterior_means
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.selection.problem import fit_and_score, largest_law_error
from slapshot.diagnosis.selection.pulses import (
    WINDOW_S,
    least_worth,
    pushes,
    pushes_set_aside,
    window_nodes,
    windows_set_aside,
)
from slapshot.diagnosis.selection.push_shapes import shaped
from slapshot.diagnosis.selection.steps import (
    P_VALUE,
    REFIT_MARGIN,
    Report,
    Rival,
    Search,
    Step,
    least_gain,
    mismatch_and_push_test,
    refit,
    step_to,
)
from slapshot.effects.joints.effect import Joint
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

_LEAST_PUSH = 0.1  # share of a joint's largest push
# Edges of pushes while friction holds a joint: share of its response to a force below which it is held; how
# near an edge that must be; moves that are tried; rounds of fits.
_HELD, _NEAR_EDGE_S, _EDGE_STEPS_S, _EDGE_ROUNDS = 0.5, 0.01, (0.04, 0.01, 0.005), 6
_LONGEST_SHARE = 0.2  # of windows, which one push may take where laws explain the others
_ANY_FORCE = 30.0  # factor on the process force of windows set aside, in which any force may act then


def with_pushes(found: Search, seed: int, report: Report) -> Search:
    """The search with pushes anew, where others went with a law before them."""
    rng = np.random.default_rng([seed, 2])
    step, steps = found.final, list[Step]()
    if has_windows_set_aside(step):
        while (pushed := push_step(step, rng, report)) is not None:
            steps.append(step := pushed)
    elif rivals := refitted_pushes(step, 0.0, report):
        best = max(rivals, key=lambda rival: rival.gain)
        if best.gain > least_gain(step.scored):
            steps.append(step_to(step, best.fit, best.effect, best.gain, rivals, rng))
    if not steps:
        return found
    dropped = tuple(effect for effect in found.dropped if not isinstance(effect, ExternalPulse))
    return replace(found, steps=(*found.steps, *steps), dropped=dropped)


def pushed_windows(fitter: Fitter, fit: Fit, noise: Noise) -> Array | None:
    """(S, L) further process force in the windows that stand out from a fit; None without any."""
    assert fitter.rig is not None, "scales of the rig tell how large pushes are"
    system, prior = fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    seen, tangent = innovations(system, noise.covariances(fitter.segments.interval)), fitter.simulator.tangent
    values = posterior_means(seen, prior.at(noise))
    speed = fit.trajectory[..., tangent.nq : tangent.nq + tangent.nv]
    longest = _LONGEST_SHARE if has_laws(fit.hypothesis) else 0.0
    return windows_set_aside(system, values, speed, noise, fitter.segments, fitter.rig, longest)


def has_laws(hypothesis: Hypothesis) -> bool:
    """Whether anything was added to a model but pushes and its free parameters."""
    return any(not isinstance(effect, ExternalPulse) for effect in hypothesis.added)


def with_windows(step: Step, set_aside: Array | None, rng: np.random.Generator) -> Step:
    """The step fitted with windows set aside; None for none."""
    fit, noise = step.scored.fit, replace(step.scored.noise, set_aside=set_aside)
    near = set_aside is not None
    scored, of = fit_and_score(step.problem, fit.hypothesis, fit.theta, fit.trajectory, noise, near=near)
    return replace(step, scored=scored, test=mismatch_and_push_test(scored, of, rng))


def has_windows_set_aside(step: Step) -> bool:
    """Whether there are windows with a larger process force of their own."""
    return step.scored.noise.set_aside is not None


def worth_of_set_aside(step: Step) -> float:
    """Nats by which the windows set aside are worth their number; what pushes in them may gain."""
    own = step.scored.fit.log_evidence - least_worth(step.scored.noise.set_aside, step.problem.segments)
    return own - _evidence_without_set_aside(step)


def without_needless_windows(step: Step, rng: np.random.Generator) -> Step:
    """The step with no windows set aside, where it then explains as much as with them, less their number.

    Laws that were found since may explain what stood out there.
    """
    if not has_windows_set_aside(step):
        return step
    worth = least_worth(step.scored.noise.set_aside, step.problem.segments)
    free = with_windows(step, None, rng)
    needless = free.scored.fit.log_evidence >= step.scored.fit.log_evidence - worth
    return free if needless and free.scored.fit.settled else step


def gain_elsewhere(step: Step, rival: Rival) -> float:
    """Nats that effects gain where nearly any force may act in the windows set aside, and beside them.

    Laws that act in these alone, such as a limit of commands that only a push brings about, are none.

    Args:
        step: before.
        rival: a fit of the step's hypothesis with one or two effects more.
    """
    left, before, problem = step.scored.residual_noise, step.scored.fit, step.problem
    if left.set_aside is None:
        return rival.gain
    size = np.where(_beside(left.set_aside > 0, problem.segments), left.set_aside.max(), 0.0)
    noise = replace(left, set_aside=_ANY_FORCE * size)
    without = problem.fitter.fit(before.hypothesis, before.theta, before.trajectory, noise)
    fit = problem.fitter.fit(rival.fit.hypothesis, rival.fit.theta, rival.fit.trajectory, noise)
    return fit.log_evidence - without.log_evidence


def _beside(nodes: NDArray[np.bool_], segments: Segments) -> NDArray[np.bool_]:
    """Some nodes, (S, L), and those before and after, for as long as they last, where a push may set in."""
    found = nodes.copy()
    for episode in np.unique(segments.episode):
        own = segments.episode == episode
        time = segments.time[own]
        at = np.sort(time[nodes[own]])
        for part in np.split(at, np.flatnonzero(np.diff(at) > WINDOW_S) + 1) if len(at) else ():
            lasts = max(part[-1] - part[0], WINDOW_S)
            found[own] |= (time > part[0] - lasts) & (time < part[-1] + lasts)
    return found


def push_step(step: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """Add the pushes of windows that were set aside; None where they are not worth it."""
    if without_needless_windows(step, rng) is not step:
        return None
    problem, fit = step.problem, step.scored.fit
    system, _ = problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
    rivals = _refitted_set_aside(step, system, report)
    best = max(rivals, key=lambda rival: rival.gain, default=None)
    if best is None or best.gain < least_gain(step.scored):
        return None
    # From here only what the shapes of pushes leave is set aside.
    fit, noise = best.fit, step.scored.residual_noise
    windows = pushed_windows(problem.fitter, fit, noise)
    if windows is not None and noise.set_aside is not None:
        windows = np.where(noise.set_aside > 0, windows, 0.0)
    step = replace(step, scored=replace(step.scored, noise=replace(step.scored.noise, set_aside=windows)))
    return step_to(step, fit, best.effect, best.gain, rivals, rng)


def refitted_pushes(step: Step, leader: float, report: Report) -> list[Rival]:
    """Pushes of each joint, where they may gain a share of what the leader does."""
    problem = step.problem
    present = {effect.key for effect in step.hypothesis.effects}
    rivals: list[Rival] = []
    if step.test.push_p_value >= P_VALUE:
        return rivals
    for push, promise in pushes(step.scored.pulses, problem.segments, problem.rig_motion):
        if push.key not in present and promise > REFIT_MARGIN * leader:
            fit = step.scored.fit
            system, _ = problem.fitter.system(fit.hypothesis, fit.theta, fit.trajectory)
            push, start = _shaped(step, system, push, np.zeros(len(push.pulses)))
            refitted = _refitted_push(step, push, start)
            if refitted is None:
                continue
            push, fit = refitted
            rivals.append(Rival(push, fit.log_evidence - step.scored.fit.log_evidence, fit))
            report(f"refitted {push.name}@{push.part}: {rivals[-1].gain:+.1f} nats")
    return rivals


def _refitted_push(step: Step, push: ExternalPulse, start: Array) -> tuple[ExternalPulse, Fit] | None:
    """A refit with those pushes that are something beside the joint's others; None where none is.

    The others are errors of their shape, or of the joint's friction where it turns around.
    """
    fit = refit(step, push, start)
    own = push.by_pulse(fit.theta[len(fit.theta) - len(push.parameters) :])
    size = np.array([np.abs(values).max() for _, values in own])
    large = size > _LEAST_PUSH * max(size.max(), _largest_push(step, push.part))
    if large.all():
        return push, fit
    if not large.any():
        return None
    left = [values for (_, values), keep in zip(own, large, strict=True) if keep]
    push = push.only(large)
    return push, refit(step, push, np.concatenate(left))


def _refitted_set_aside(step: Step, system: Linear, report: Report) -> list[Rival]:
    """Pushes of each joint in the windows that were set aside, compared with one process force everywhere."""
    problem, noise = step.problem, step.scored.residual_noise
    known = [pulse for e in step.hypothesis.effects if isinstance(e, ExternalPulse) for pulse in e.pulses]
    found = pushes_set_aside(system, noise, problem.segments, problem.rig_motion, known)
    level = _evidence_without_set_aside(step) if found else 0.0
    rivals: list[Rival] = []
    for push, force in found:
        # From about their forces: without any, friction may hold the joint, and motion tells of none.
        push, force = _with_edges_while_held(step, system, push, force)
        push, start = _shaped(step, system, push, force)
        refitted = _refitted_push(step, push, start)
        if refitted is None:
            continue
        push, fit = refitted
        # Each may have come in any window.
        windows = problem.segments.time.size / window_nodes(problem.segments)
        gain = fit.log_evidence - level - len(push.pulses) * float(np.log(windows))
        rivals.append(Rival(push, gain, fit))
        report(f"refitted {push.name}@{push.part}: {gain:+.1f} nats")
    return rivals


def _with_edges_while_held(
    step: Step, system: Linear, push: ExternalPulse, force: Array
) -> tuple[ExternalPulse, Array]:
    """The pushes, with those edges at which friction holds the joint where models explain most; their forces.

    About a trajectory at rest a linear system tells nothing of a force that would move the joint.
    """
    if system.process is None:
        return push, force
    problem = step.problem
    joint = next(joint for joint in problem.rig_motion.joints if joint.name == push.part)
    held = _held(system, joint)
    push, force = _joined_while_held(push, force, held, problem.segments)
    pulses = list(push.pulses)
    for i in range(len(pulses)):
        if _near_an_edge(held, pulses[i], problem.segments):
            pulses[i] = _best_edges(step, joint, pulses, i, float(force[i]))
    return ExternalPulse(joint, pulses), force


def _held(system: Linear, joint: Joint) -> NDArray[np.bool_]:
    """(S, L) nodes at which friction holds a joint."""
    free = np.linalg.norm(system.process_force[..., joint.v], axis=-1)
    return np.asarray(np.linalg.norm(system.B[..., joint.v], axis=-1) < _HELD * free)


def _shaped(step: Step, system: Linear, push: ExternalPulse, force: Array) -> tuple[ExternalPulse, Array]:
    """See `shaped`; those that begin or end while friction holds the joint stay: it tells nothing of them."""
    problem, named = step.problem, list[Pulse]()
    for effect in step.hypothesis.effects:
        if isinstance(effect, ExternalPulse) and effect.part == push.part:
            named += effect.pulses
    joint = next(joint for joint in problem.rig_motion.joints if joint.name == push.part)
    held = _held(system, joint)
    constant = [_near_an_edge(held, pulse, problem.segments) for pulse in push.pulses]
    return shaped(system, push, force, step.scored.residual_noise, problem.segments, joint, constant, named)


def _joined_while_held(
    push: ExternalPulse, force: Array, held: NDArray[np.bool_], segments: Segments
) -> tuple[ExternalPulse, Array]:
    """Pushes of one direction as one, where friction holds the joint between them, and their larger force."""
    pulses, sizes = list[Pulse](), list[float]()
    for pulse, size in zip(push.pulses, force, strict=True):
        if pulses and pulses[-1].episode == pulse.episode and sizes[-1] * size > 0:
            own = (segments.ids[segments.episode] == pulse.episode)[:, None]
            between = own & (segments.time > pulses[-1].end) & (segments.time < pulse.begin)
            gap = pulse.begin - pulses[-1].end
            recorded = (between.sum() + 1.5) * segments.interval > gap
            if recorded and held[between].all():
                pulses[-1] = replace(pulses[-1], end=pulse.end)
                sizes[-1] = max(sizes[-1], size, key=abs)
                continue
        pulses.append(pulse)
        sizes.append(float(size))
    return push.of(pulses), np.array(sizes)


def _near_an_edge(nodes: NDArray[np.bool_], pulse: Pulse, segments: Segments) -> bool:
    """Whether any of some nodes (S, L) is near the begin or the end of a push."""
    own = segments.ids[segments.episode] == pulse.episode
    time = segments.time[own][nodes[own]]
    return any((np.abs(time - at) <= _NEAR_EDGE_S).any() for at in (pulse.begin, pulse.end))


def _best_edges(step: Step, joint: Joint, pulses: Sequence[Pulse], i: int, force: float) -> Pulse:
    """A push of some, with edges moved as long as it explains more of the segments around it.

    First beside any force in its windows, under which few edges are dead ends, then alone, since beside any
    force no edge is much worse than another.
    """
    problem, scored, pulse = step.problem, step.scored, pulses[i]
    segments, margin = problem.segments, 2 * WINDOW_S
    near = (segments.time > pulse.begin - margin) & (segments.time < pulse.end + margin)
    some = np.flatnonzero((segments.ids[segments.episode] == pulse.episode) & near.any(axis=1))
    fitter, beside = problem.fitter.select(some), scored.residual_noise.select(some)
    others = [other for k, other in enumerate(pulses) if k != i and other.episode == pulse.episode]
    alone = beside
    if beside.set_aside is not None:
        own, time = near[some], segments.time[some]
        for other in others:
            own &= (time < other.begin - WINDOW_S) | (time > other.end + WINDOW_S)
        alone = replace(beside, set_aside=np.where(own, 0.0, beside.set_aside))

    def evidence(moved: Pulse, noise: Noise) -> float:
        overlaps = any(moved.begin < other.end and other.begin < moved.end for other in others)
        if overlaps or moved.end - moved.begin < segments.interval:
            return -np.inf
        hypothesis = step.hypothesis.with_effect(ExternalPulse(joint, [moved]))
        theta = np.append(scored.fit.theta, force)
        fit = fitter.fit(hypothesis, theta, scored.fit.trajectory[some], noise, _EDGE_ROUNDS)
        return fit.log_evidence

    for noise in (beside, alone):
        most = evidence(pulse, noise)
        for length in _EDGE_STEPS_S:
            length = max(length, segments.interval)
            for edge, way in (("begin", 1), ("begin", -1), ("end", 1), ("end", -1)):
                for _ in range(round(margin / length)):
                    moved = replace(pulse, **{edge: getattr(pulse, edge) + way * length})
                    found = evidence(moved, noise)
                    if found <= most:
                        break
                    pulse, most = moved, found
    return pulse


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
    largest = largest_law_error(step.scored.noise)
    noise = fit_process_force(system, prior, noise.without_set_aside, interval, largest)
    return step.problem.fitter.fit(
        fit.hypothesis, fit.theta, fit.trajectory, noise, rounds=0, known=system
    ).log_evidence
