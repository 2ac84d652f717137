"""Detection of external pushes: a constant force in every short window, compared with all others.

A window's force is judged by the spread over all windows, so that permanent forces and small model errors do
not count as pushes. A few windows with enormous pushes are set aside from the fit of everything else: they
have a further process force.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.law_error import NEAR_REST
from slapshot.diagnosis.fit.noise import FORCE_HOLD_S, Noise
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.effect import Joint, RigMotion
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

WINDOW_S = 0.05
_ALIKE_NATS = 2.0  # by which edges of a push may fit worse than the best ones
_ROUNDING_S = 1e-6
_SIGNIFICANCE = 0.01  # family-wise significance level
_MAX_PUSHES = 40  # maximum number of pushes of a joint
# Robust standard deviations beyond which a window's force is no part of the model's error, or beyond half of
# which that of a window set aside before is none; largest share of windows, beyond which the model is wrong
# rather than pushed; rounds, in which the spread decreases.
_ENORMOUS_SD, _MAX_SHARE_SET_ASIDE, SET_ASIDE_ROUNDS = 5.0, 0.1, 6
# Share of the largest force in adjacent windows set aside, below which the sign of a window's force is
# uncertain, and of the rms torque of a joint, below which what acts where it turns around may be friction.
_STRONG = 0.25
_TURNING = 0.1  # share of that torque by which friction errs there
# Rms share by which a push differs from a constant one, for windows at a time: that of a trapezium of which
# half is flat, or of half a sine wave. Of a force that is linear between knots it falls with their number: an
# edge errs in but one interval.
_SHAPE_ERROR = 0.4
_EDGES = 2  # windows within which each edge of a push is fitted
_SIDE_LOBE = 0.25  # share of a push below which another that touches it is an error of its shape


@dataclass(frozen=True)
class Scan:
    """Standardised force of every window.

    Attributes:
        ratio: (S, windows, joints) force over its spread.
        nodes: of a window; the last one of a segment includes the remainder.
        observable: (S, windows, joints) whether a window has enough information.
        correlation: (S, k, k) of the forces of a segment's windows, k = windows * joints.
    """

    ratio: Array
    nodes: int
    observable: NDArray[np.bool_]
    correlation: Array

    def p_value(self, rng: np.random.Generator, count: int) -> float:
        """Monte Carlo p-value of the largest force without any push, with the windows' correlations."""
        eigenvalues, vectors = np.linalg.eigh(self.correlation)
        roots = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]
        largest = float(np.abs(self.ratio).max(initial=0.0))
        exceeding = 0
        for _ in range(count):
            drawn = np.einsum("sij,sj->si", roots, rng.standard_normal(roots.shape[:2]))
            ratio = _spread(drawn.reshape(self.observable.shape), self.observable)
            exceeding += int(np.abs(ratio).max(initial=0.0) >= largest)
        return (1 + exceeding) / (1 + count)


def scan(
    system: Linear,
    values: Array,
    noise: Noise,
    segments: Segments,
    rig: RigMotion,
    known: Sequence[Pulse] = (),
    frictional: Mapping[str, Array] | None = None,
) -> Scan:
    """Scan the joints of a linear system.

    Args:
        system: with the columns of parameters and nuisance.
        values: of those columns.
        noise: of the data.
        segments: data.
        rig: whose joints may be pushed.
        known: pushes in the hypothesis, whose windows are not judged again.
        frictional: joints whose friction was named, and their speeds (S, L). Where they stop, set off or turn
            around, a force below a quarter of the usual torque may be an error of that friction: it is not
            judged.
    """
    system = system.moved(values)
    near = _turning(frictional or {}, noise, segments, rig)
    windows = _windows(system, replace(noise, set_aside=near), segments, rig)
    windows.observable[_overlapping(known, windows, segments)] = False
    if near is not None:
        force = np.abs(windows.score) / np.maximum(windows.information, 1e-300)
        weak = force < _STRONG * np.array([joint.torque for joint in rig.joints])
        windows.observable[weak & _windows_with(near, segments)[..., None]] = False
    root = np.sqrt(np.maximum(np.where(windows.observable, windows.information, np.inf), 1e-300))
    flat = root.reshape(len(root), -1)
    correlation = windows.gram / (flat[:, :, None] * flat[:, None, :])
    ratio = _spread(windows.score / root, windows.observable)
    return Scan(ratio, windows.nodes, windows.observable, correlation)


def push_error(
    pushes: Iterable[tuple[ExternalPulse, Array]], torque: Array, segments: Segments, rig: RigMotion
) -> Array | None:
    """(S, L) process force by which pushes may differ from constant ones, see `Noise`; None without pushes.

    Args:
        pushes: effects and their values.
        torque: (nv,) scale of forces.
        segments: data.
        rig: whose joints are pushed.
    """
    error = np.zeros(segments.shape)
    v = {joint.name: joint.v for joint in rig.joints}
    for push, values in pushes:
        for pulse, own in push.by_pulse(values):
            size = shape_error(pulse, float(np.abs(own).max()), segments) / torque[v[push.part]]
            error = np.maximum(error, size)
    return error if error.any() else None


def shape_error(pulse: Pulse, largest: float, segments: Segments) -> Array:
    """(S, L) by which a push may differ from its shape, as the sd of a force held for `FORCE_HOLD_S`.

    Args:
        pulse: push.
        largest: force.
        segments: data.
    """
    same = (segments.ids[segments.episode] == pulse.episode)[:, None]
    margin = WINDOW_S + _ROUNDING_S
    near = same & (segments.time > pulse.begin - margin) & (segments.time < pulse.end + margin)
    share = _SHAPE_ERROR / max(pulse.knots - 1, 1)
    return np.asarray(np.where(near, share * largest * np.sqrt(WINDOW_S / FORCE_HOLD_S), 0.0))


def _turning(
    frictional: Mapping[str, Array], noise: Noise, segments: Segments, rig: RigMotion
) -> Array | None:
    """(S, L) further process force where joints with friction turn around.

    What their friction does there, which no other window is to explain, is a share of what moves them.
    """
    if not frictional:
        return None
    nodes, L = window_nodes(segments), segments.shape[1]
    count = L // nodes
    further = np.zeros(segments.shape)
    for joint in rig.joints:
        if joint.name in frictional:
            size = _held_force(_TURNING * joint.torque, joint.v, noise, segments)
            for s, w in np.argwhere(_near_rest(frictional[joint.name], joint.speed, nodes, count)):
                at = _nodes_of(int(w), count, nodes, L)
                further[s, at] = np.maximum(further[s, at], size)
    return further


def _held_force(force: float, v: int, noise: Noise, segments: Segments) -> float:
    """A force on a degree of freedom that is held for an interval, as a process force."""
    return float(force / noise.torque[v] * np.sqrt(segments.interval / FORCE_HOLD_S))


@dataclass(frozen=True)
class _Windows:
    """Scores and information of a constant force in each window, (S, windows, joints); gram is (S, k, k)."""

    nodes: int
    score: Array
    information: Array
    observable: NDArray[np.bool_]
    gram: Array


def _windows(system: Linear, noise: Noise, segments: Segments, rig: RigMotion) -> _Windows:
    S, L = segments.shape
    nodes = window_nodes(segments)
    count, joints = L // nodes, rig.joints
    W = np.zeros((S, L, system.d.shape[-1], count * len(joints)))
    for w in range(count):
        for j, joint in enumerate(joints):
            at = _nodes_of(w, count, nodes, L)
            W[:, at, :, w * len(joints) + j] = system.B[:, at, :, joint.v]
    psi = np.zeros((*system.r.shape, W.shape[-1]))
    found = innovations(system.with_columns(W, psi), noise.covariances(segments.interval))
    shape = (S, count, len(joints))
    b = np.einsum("stc,stck->sk", found.e, found.Z).reshape(shape)
    h = np.einsum("stck,stck->sk", found.Z, found.Z).reshape(shape)
    # Windows with almost no information are not judged; where they are set aside, that alone makes it small.
    set_aside = _windows_with(noise.set_aside, segments)[..., None]
    observable = (h > 0) & (set_aside | (h > 1e-3 * (np.median(h[h > 0]) if np.any(h > 0) else 0.0)))
    return _Windows(nodes, b, h, observable, np.einsum("stck,stcl->skl", found.Z, found.Z))


def _overlapping(pulses: Sequence[Pulse], windows: _Windows, segments: Segments) -> NDArray[np.bool_]:
    """(S, windows) which a push overlaps."""
    count = windows.score.shape[1]
    length = windows.nodes * segments.interval
    begin = segments.time[:, :1] + np.arange(count) * length
    found = np.zeros(begin.shape, bool)
    for pulse in pulses:
        same = segments.ids[segments.episode] == pulse.episode
        found |= (
            same[:, None] & (begin < pulse.end - _ROUNDING_S) & (begin + length > pulse.begin + _ROUNDING_S)
        )
    return found


def window_nodes(segments: Segments) -> int:
    """Nodes of a window."""
    return max(2, round(WINDOW_S / segments.interval))


def log_pushes(segments: Segments, rig: RigMotion) -> float:
    """Logarithm of the number of pushes that data can tell apart: any window of a joint, and edges nearby."""
    nodes = window_nodes(segments)
    return float(np.log(segments.time.size / nodes * len(rig.joints) * (_EDGES * nodes) ** 2))


def _nodes_of(window: int, count: int, nodes: int, segment: int) -> slice:
    """Of a window; the last one of a segment includes the remainder."""
    return slice(window * nodes, (window + 1) * nodes if window < count - 1 else segment)


def _windows_with(further: Array | None, segments: Segments) -> NDArray[np.bool_]:
    """(S, windows) at whose first node there is further process force."""
    (S, L), nodes = segments.shape, window_nodes(segments)
    if further is None:
        return np.zeros((S, L // nodes), bool)
    return np.asarray(further[:, ::nodes][:, : L // nodes] > 0)


def _forces(windows: _Windows, noise: Noise, segments: Segments, rig: RigMotion) -> Array:
    """(S, windows, joints) force in each window; where it was set aside, about none of the size known there.

    While friction holds a joint, the motion tells nothing of a force, and any other estimate means nothing.
    """
    information = np.where(windows.observable, windows.information, np.inf)
    if noise.set_aside is not None:
        size = noise.set_aside[:, :: windows.nodes][:, : windows.score.shape[1], None]
        unit = np.array([_held_force(1.0, joint.v, noise, segments) for joint in rig.joints])
        set_aside = np.broadcast_to(size > 0, information.shape)
        information = (
            information + np.divide(unit, size, out=np.zeros(information.shape), where=set_aside) ** 2
        )
    return np.asarray(windows.score / information)


def _forces_set_aside(
    windows: _Windows, forces: Array, set_aside: NDArray[np.bool_], segments: Segments
) -> Array:
    """(S, windows, joints) force in windows set aside, on the joint on which it stands out most."""
    information = np.where(windows.observable, windows.information, np.inf)
    strength = np.abs(windows.score) / np.sqrt(information)
    own = strength == strength.max(-1, keepdims=True)
    force = np.where(own & set_aside[..., None], forces, 0.0)
    for following in segments.runs():
        for j in range(force.shape[-1]):
            whole = _with_signs_of_strong(force[following, :, j].reshape(-1))
            force[following, :, j] = whole.reshape(len(following), -1)
    return force


def _with_signs_of_strong(force: Array) -> Array:
    """Forces in runs of windows without their weak ends; a weak one gets the sign of the nearest strong."""
    force = force.copy()
    there = np.flatnonzero(force)
    for run in np.split(there, np.flatnonzero(np.diff(there) > 1) + 1):
        size = np.abs(force[run])
        strong = np.flatnonzero(size >= _STRONG * size.max(initial=0.0))
        if len(strong):
            nearest = strong[np.abs(np.arange(len(run))[:, None] - strong).argmin(1)]
            force[run] = size * np.sign(force[run[nearest]])
            force[run[: strong[0]]] = force[run[strong[-1] + 1 :]] = 0
    return force


def windows_set_aside(
    system: Linear,
    values: Array,
    speed: Array,
    noise: Noise,
    segments: Segments,
    rig: RigMotion,
    longest: float = 0.0,
) -> Array | None:
    """Further process force in the few windows of enormous pushes.

    Where a joint stops, sets off or turns around, a push must be a quarter of what usually moves the
    joint: there the friction that a model lacks is not linear.

    Args:
        system: with the columns of parameters and nuisance.
        values: of those columns.
        speed: (S, L, nv) of the degrees of freedom.
        noise: of the data; some windows may be set aside already.
        segments: data.
        rig: whose joints may be pushed.
        longest: share of windows that one push may take beside the others.

    Returns:
        (S, L), 0 elsewhere; None where there are no such pushes, or too many to be pushes.
    """
    windows = _windows(system.moved(values), noise, segments, rig)
    S, count, _ = windows.score.shape
    before = np.zeros(segments.shape) if noise.set_aside is None else noise.set_aside
    further = np.zeros(segments.shape)
    known = _windows_with(noise.set_aside, segments)
    forces = _forces(windows, noise, segments, rig)
    pushed = np.zeros((S, count), bool)
    for j, joint in enumerate(rig.joints):
        observable = windows.observable[..., j]
        if not observable.any():
            continue
        force = forces[..., j]
        # In a window set aside the ratio is bounded, since its process force is as large as the push.
        information = np.where(observable, windows.information[..., j], np.inf)
        ratio = windows.score[..., j] / np.sqrt(information)
        large = observable & np.where(
            known,
            np.abs(force) > _ENORMOUS_SD / 2 * _robust_sd(force[observable & ~known]),
            np.abs(ratio) > _ENORMOUS_SD * _robust_sd(ratio[observable & ~known]),
        )
        near = _near_rest(speed[..., joint.v], joint.speed, windows.nodes, count)
        large &= (np.abs(force) > _STRONG * joint.torque) | ~near
        held = _continued(large, known & near) & ~large
        pushed |= large | held
        for s, w in np.argwhere(large | held):
            at = _nodes_of(int(w), count, windows.nodes, segments.shape[1])
            size = before[s, at] if held[s, w] else _held_force(abs(force[s, w]), joint.v, noise, segments)
            further[s, at] = np.maximum(further[s, at], size)
    one = min(_longest_run(pushed, segments) / pushed.size, longest)
    return further if 0 < pushed.mean() <= _MAX_SHARE_SET_ASIDE + one else None


def _longest_run(pushed: NDArray[np.bool_], segments: Segments) -> int:
    """Most windows, of (S, windows), that follow each other without one that is not pushed."""
    found = 0
    for following in segments.runs():
        there = np.flatnonzero(pushed[following].reshape(-1))
        runs = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
        found = max(found, *map(len, runs))
    return found


def _continued(pushed: NDArray[np.bool_], held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Windows of pushes, (S, windows), with those of some others that continue one.

    While friction holds a joint, its motion does not tell whether a push goes on.
    """
    found, before = pushed, np.zeros_like(pushed)
    while not np.array_equal(found, before):
        before, found = found, found.copy()
        found[:, 1:] |= before[:, :-1] & held[:, 1:]
        found[:, :-1] |= before[:, 1:] & held[:, :-1]
    return found


def least_worth(set_aside: Array | None, segments: Segments) -> float:
    """Nats that windows set aside must gain, since each could have been any; 0 for none."""
    if set_aside is None:
        return 0.0
    nodes = window_nodes(segments)
    return float(np.sum(set_aside > 0) / nodes * np.log(set_aside.size / nodes))


def _near_rest(speed: Array, usual: float, nodes: int, count: int) -> NDArray[np.bool_]:
    """(S, windows) at some node of which, or next to which, a joint is slow or turns around."""
    slow = np.abs(speed) < NEAR_REST * usual
    slow[:, 1:] |= speed[:, 1:] * speed[:, :-1] < 0
    found = np.zeros((len(speed), count), bool)
    for w in range(count):
        at = _nodes_of(w, count, nodes, speed.shape[1])
        found[:, w] = slow[:, max(0, at.start - 1) : at.stop + 1].any(1)
    return found


def _robust_sd(values: Array) -> float:
    """By the median of absolute values, with mean 0."""
    return 1.4826 * float(np.median(np.abs(values))) if len(values) else 0.0


def _spread(ratio: Array, observable: NDArray[np.bool_]) -> Array:
    """Forces over the robust spread of a joint's windows, where that exceeds one."""
    ratio = ratio.copy()
    for j in range(ratio.shape[-1]):
        own = ratio[..., j][observable[..., j]]
        ratio[..., j] /= max(_robust_sd(own), 1.0)
    return ratio


def pushes(found: Scan, segments: Segments, rig: RigMotion) -> Sequence[tuple[ExternalPulse, float]]:
    """Significant pushes, one effect for each joint, and their approximate gain in nats."""
    limit = float(norm.isf(_SIGNIFICANCE / 2 / max(found.ratio.size, 1)))
    effects = []
    for j, effect, _ in _effects(found.ratio, found.nodes, segments, rig, limit):
        ratio = np.abs(found.ratio[..., j])
        effects.append((effect, float(0.5 * np.sum(ratio[ratio > limit] ** 2))))
    return effects


def pushes_set_aside(
    system: Linear, noise: Noise, segments: Segments, rig: RigMotion, known: Sequence[Pulse]
) -> Sequence[tuple[ExternalPulse, Array]]:
    """The pushes in the windows that are set aside, one effect for each joint, and about their forces.

    Args:
        system: about the fitted trajectory.
        noise: of the data.
        segments: data.
        rig: whose joints may be pushed.
        known: pushes in the hypothesis, whose windows are not judged again.
    """
    if noise.set_aside is None:
        return []
    windows = _windows(system, noise, segments, rig)
    forces = _forces(windows, noise, segments, rig)
    force = _forces_set_aside(windows, forces, _windows_with(noise.set_aside, segments), segments)
    force[_overlapping(known, windows, segments)] = 0
    found: list[tuple[ExternalPulse, Array]] = []
    for j, push, size in _effects(force, windows.nodes, segments, rig, 1e-300):
        joint = rig.joints[j]
        pulses = [_with_edges(p, push.pulses, joint, system, noise, segments) for p in push.pulses]
        found.append((ExternalPulse(joint, pulses), size))
    return found


def _with_edges(
    pulse: Pulse, pulses: Sequence[Pulse], joint: Joint, system: Linear, noise: Noise, segments: Segments
) -> Pulse:
    """The push with edges by a constant force, within a window of the given ones: the shortest that fits.

    While friction holds the joint, all edges fit alike: had the push acted there, it would have moved it.

    Args:
        pulse: whose edges are those of windows.
        pulses: of the joint: the time between two is shared.
        joint: on which it acts.
        system: about the fitted trajectory.
        noise: of the data, with the push's windows set aside.
        segments: data.
    """
    same = segments.ids[segments.episode] == pulse.episode
    least = max([pulse.begin - WINDOW_S, *((p.end + pulse.begin) / 2 for p in pulses if _before(p, pulse))])
    most = min([pulse.end + WINDOW_S, *((pulse.end + p.begin) / 2 for p in pulses if _before(pulse, p))])
    near = same[:, None] & (segments.time > least - _ROUNDING_S) & (segments.time < most - _ROUNDING_S)
    some = np.flatnonzero(near.any(1))
    near, time = near[some], segments.time[some]
    # Pieces are nodes, but for the middle of a long push, which goes with the node before it.
    middle = (time > pulse.begin + WINDOW_S - _ROUNDING_S) & (time < pulse.end - WINDOW_S - _ROUNDING_S)
    begins = np.unique(np.round(time[near & ~middle], 9))
    ends = np.append(begins[1:], most)
    piece = np.searchsorted(begins, time + _ROUNDING_S, "right") - 1
    part, own = system.select(some), noise.select(some)
    if own.set_aside is not None:
        own = replace(own, set_aside=np.where(near, 0.0, own.set_aside))
    W = np.zeros((*part.d.shape, len(begins)))
    s, t = np.nonzero(near)
    W[s, t, :, piece[s, t]] = part.B[s, t, :, joint.v]
    part = part.with_columns(W, np.zeros((*part.r.shape, len(begins))))
    found = innovations(part, own.covariances(segments.interval))
    z = found.Z.reshape(found.e.size, -1)
    # Of a constant force in pieces i to j: sums over a row and over a square.
    score = np.append(0.0, np.cumsum(z.T @ found.e.reshape(-1)))
    gram = np.zeros((len(begins) + 1,) * 2)
    gram[1:, 1:] = np.cumsum(np.cumsum(z.T @ z, 0), 1)
    information = (gram.diagonal()[1:] + gram.diagonal()[:-1, None]) - (gram[:-1, 1:] + gram[1:, :-1].T)
    # Where friction holds the joint, differences of sums are rounding.
    information = np.maximum(information, 1e-9 * information.max() + 1e-300)
    gain = 0.5 * (score[1:] - score[:-1, None]) ** 2 / information
    length = np.where(gain < np.triu(gain).max() - _ALIKE_NATS, np.inf, ends - begins[:, None])
    length[np.tril_indices(len(begins), -1)] = np.inf
    first, last = np.unravel_index(length.argmin(), length.shape)
    return replace(pulse, begin=float(begins[first]), end=float(ends[last]))


def _before(pulse: Pulse, other: Pulse) -> bool:
    """Whether a push comes before another of its episode."""
    return pulse.episode == other.episode and pulse.end < other.begin + _ROUNDING_S


def _effects(
    strength: Array, nodes: int, segments: Segments, rig: RigMotion, limit: float
) -> Iterator[tuple[int, ExternalPulse, Array]]:
    """Joints, their pushes of strengths (S, windows, joints) beyond a limit, and the largest of each push."""
    for j, joint in enumerate(rig.joints):
        pulses: list[tuple[float, Pulse]] = []
        for s in range(len(strength)):
            pulses += _pushes_in_segment(strength[s, :, j], nodes, segments, s, limit)
        joined = _merge_adjacent(sorted(pulses, key=lambda item: (item[1].episode, item[1].begin)))
        joined = [item for item in joined if not any(_is_side_lobe(item, other) for other in joined)]
        strongest = sorted(joined, key=lambda item: -abs(item[0]))[:_MAX_PUSHES]
        if strongest:
            ordered = sorted(strongest, key=lambda item: (item[1].episode, item[1].begin))
            largest = np.array([strength for strength, _ in ordered])
            yield j, ExternalPulse(joint, [pulse for _, pulse in ordered]), largest


def _pushes_in_segment(
    strength: Array, nodes: int, segments: Segments, s: int, limit: float
) -> list[tuple[float, Pulse]]:
    """Runs of significant windows with neighbours of the same sign, and their signed strength."""
    out = []
    w = 0
    while w < len(strength):
        if abs(strength[w]) < limit:
            w += 1
            continue
        sign, begin = np.sign(strength[w]), w
        while begin > 0 and sign * strength[begin - 1] > limit / 2:
            begin -= 1
        end = w + 1
        while end < len(strength) and sign * strength[end] > limit / 2:
            end += 1
        start = float(segments.time[s, 0])
        last = end * nodes if end < len(strength) else segments.shape[1]
        pulse = Pulse(
            int(segments.ids[segments.episode[s]]), float(segments.order[s]),
            start + begin * nodes * segments.interval, start + last * segments.interval,
        )  # fmt: skip
        out.append((float(sign * np.abs(strength[begin:end]).max()), pulse))
        w = end
    return out


def _is_side_lobe(item: tuple[float, Pulse], other: tuple[float, Pulse]) -> bool:
    """Whether a pulse is next to a much stronger one: the window's force then stands for what that leaves."""
    (strength, pulse), (strongest, beside) = item, other
    apart = max(beside.begin - pulse.end, pulse.begin - beside.end)
    weak = abs(strength) < _SIDE_LOBE * abs(strongest)
    return weak and pulse.episode == beside.episode and apart < WINDOW_S - _ROUNDING_S


def _merge_adjacent(pulses: Sequence[tuple[float, Pulse]]) -> list[tuple[float, Pulse]]:
    """Merge adjacent pulses of the same sign, as at the end of a segment."""
    out: list[tuple[float, Pulse]] = []
    for strength, pulse in pulses:
        before = out[-1] if out else None
        if (
            before is not None
            and before[1].episode == pulse.episode
            and pulse.begin - before[1].end < _ROUNDING_S
            and before[0] * strength > 0
        ):
            whole = Pulse(pulse.episode, pulse.order, before[1].begin, pulse.end)
            out[-1] = (max(before[0], strength, key=abs), whole)
        else:
            out.append((strength, pulse))
    return out
