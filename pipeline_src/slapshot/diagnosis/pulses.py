"""Detection of external pushes: a constant force in every short window, compared with all others.

A window's force is judged by the spread over all windows, so that permanent forces and small model errors do
not count as pushes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from slapshot.arrays import Array
from slapshot.diagnosis.filter import Linear, innovations
from slapshot.diagnosis.noise import Noise
from slapshot.diagnosis.segments import Segments
from slapshot.effects.joints.effect import RigMotion
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

WINDOW_S = 0.05
_SIGNIFICANCE = 0.01  # family-wise significance level
_MAX_PUSHES = 40  # maximum number of pushes of a joint


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


def scan(system: Linear, values: Array, noise: Noise, segments: Segments, rig: RigMotion) -> Scan:
    """Scan the joints of a linear system.

    Args:
        system: with the columns of parameters and nuisance.
        values: of those columns.
        noise: of the data.
        segments: data.
        rig: whose joints may be pushed.
    """
    S, L = segments.shape
    nodes = max(2, round(WINDOW_S / segments.interval))
    count, joints = L // nodes, rig.joints
    system = system.moved(values)
    W = np.zeros((S, L, system.d.shape[-1], count * len(joints)))
    for w in range(count):
        at = slice(w * nodes, (w + 1) * nodes if w < count - 1 else L)
        for j, joint in enumerate(joints):
            W[:, at, :, w * len(joints) + j] = system.B[:, at, :, joint.v]
    psi = np.zeros((*system.r.shape, W.shape[-1]))
    found = innovations(system.with_columns(W, psi), noise.covariances(segments.interval))
    b = np.einsum("stc,stck->sk", found.e, found.Z)
    h = np.einsum("stck,stck->sk", found.Z, found.Z)
    # Windows with almost no information are not judged.
    observable = h > 1e-3 * np.median(h[h > 0]) if np.any(h > 0) else h > 0
    root = np.sqrt(np.maximum(np.where(observable, h, np.inf), 1e-300))
    shape = (S, count, len(joints))
    correlation = np.einsum("stck,stcl->skl", found.Z, found.Z) / (root[:, :, None] * root[:, None, :])
    observable = observable.reshape(shape)
    return Scan(_spread((b / root).reshape(shape), observable), nodes, observable, correlation)


def _spread(ratio: Array, observable: NDArray[np.bool_]) -> Array:
    """Forces over the robust spread of a joint's windows, where that exceeds one."""
    ratio = ratio.copy()
    for j in range(ratio.shape[-1]):
        own = ratio[..., j][observable[..., j]]
        ratio[..., j] /= max(1.4826 * float(np.median(np.abs(own))) if len(own) else 1.0, 1.0)
    return ratio


def pushes(found: Scan, segments: Segments, rig: RigMotion) -> Sequence[tuple[ExternalPulse, float]]:
    """Significant pushes, one effect for each joint, and their approximate gain in nats."""
    limit = float(norm.isf(_SIGNIFICANCE / 2 / max(found.ratio.size, 1)))
    effects = []
    for j, joint in enumerate(rig.joints):
        pulses: list[tuple[float, Pulse]] = []
        for s in range(found.ratio.shape[0]):
            pulses += _pushes_in_segment(found, segments, s, j, limit)
        joined = _merge_adjacent(sorted(pulses, key=lambda item: (item[1].episode, item[1].begin)))
        strongest = sorted(joined, key=lambda item: -abs(item[0]))[:_MAX_PUSHES]
        if strongest:
            ordered = sorted((p for _, p in strongest), key=lambda p: (p.episode, p.begin))
            observable = np.abs(found.ratio[..., j])
            effects.append(
                (ExternalPulse(joint, ordered), float(0.5 * np.sum(observable[observable > limit] ** 2)))
            )
    return effects


def _pushes_in_segment(
    found: Scan, segments: Segments, s: int, j: int, limit: float
) -> list[tuple[float, Pulse]]:
    """Runs of significant windows with neighbours of the same sign, and their signed strength."""
    ratio = found.ratio[s, :, j]
    out = []
    w = 0
    while w < len(ratio):
        if abs(ratio[w]) < limit:
            w += 1
            continue
        sign, begin = np.sign(ratio[w]), w
        while begin > 0 and sign * ratio[begin - 1] > limit / 2:
            begin -= 1
        end = w + 1
        while end < len(ratio) and sign * ratio[end] > limit / 2:
            end += 1
        start = float(segments.time[s, 0])
        last = end * found.nodes if end < len(ratio) else segments.shape[1]
        pulse = Pulse(
            int(segments.ids[segments.episode[s]]), float(segments.order[s]),
            start + begin * found.nodes * segments.interval, start + last * segments.interval,
        )  # fmt: skip
        out.append((float(sign * np.abs(ratio[begin:end]).max()), pulse))
        w = end
    return out


def _merge_adjacent(pulses: Sequence[tuple[float, Pulse]]) -> list[tuple[float, Pulse]]:
    """Merge adjacent pulses of the same sign, as at the end of a segment."""
    out: list[tuple[float, Pulse]] = []
    for strength, pulse in pulses:
        before = out[-1] if out else None
        if (
            before is not None
            and before[1].episode == pulse.episode
            and pulse.begin - before[1].end < 1e-6
            and before[0] * strength > 0
        ):
            whole = Pulse(pulse.episode, pulse.order, before[1].begin, pulse.end)
            out[-1] = (max(before[0], strength, key=abs), whole)
        else:
            out.append((strength, pulse))
    return out
