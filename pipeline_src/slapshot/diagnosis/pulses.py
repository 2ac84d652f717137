"""When does something push? A constant force in every short window, against all others.

A window's force is judged by the spread of all windows: what acts always is no push, and neither is what the
model gets a little wrong everywhere.
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
from slapshot.effects.joints.effect import Situation
from slapshot.effects.joints.external_pulse import ExternalPulse, Pulse

WINDOW_S = 0.05
_LEVEL = 0.01  # chance that any window of a recording without pushes is called one
_MOST = 40  # pushes of a joint that are fitted


@dataclass(frozen=True)
class Scan:
    """Standardised force of every window.

    Attributes:
        ratio: (S, windows, joints) force over its spread.
        nodes: of a window; the last of a segment has what is left over as well.
        told: (S, windows, joints) whether enough is observed of a window.
        correlation: (S, k, k) of the forces of a segment's windows, k = windows * joints.
    """

    ratio: Array
    nodes: int
    told: NDArray[np.bool_]
    correlation: Array

    def p_value(self, rng: np.random.Generator, count: int) -> float:
        """Chance of a force as large without any push, by draws with the windows' correlations."""
        eigenvalues, vectors = np.linalg.eigh(self.correlation)
        roots = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]
        largest = float(np.abs(self.ratio).max(initial=0.0))
        exceeding = 0
        for _ in range(count):
            drawn = np.einsum("sij,sj->si", roots, rng.standard_normal(roots.shape[:2]))
            ratio = _spread(drawn.reshape(self.told.shape), self.told)
            exceeding += int(np.abs(ratio).max(initial=0.0) >= largest)
        return (1 + exceeding) / (1 + count)


def scan(system: Linear, values: Array, noise: Noise, segments: Segments, rig: Situation) -> Scan:
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
    # Where next to nothing is observed of a window there is nothing to be judged.
    told = h > 1e-3 * np.median(h[h > 0]) if np.any(h > 0) else h > 0
    root = np.sqrt(np.maximum(np.where(told, h, np.inf), 1e-300))
    shape = (S, count, len(joints))
    correlation = np.einsum("stck,stcl->skl", found.Z, found.Z) / (root[:, :, None] * root[:, None, :])
    told = told.reshape(shape)
    return Scan(_spread((b / root).reshape(shape), told), nodes, told, correlation)


def _spread(ratio: Array, told: NDArray[np.bool_]) -> Array:
    """Forces over the spread of all windows of a joint, where that is larger than it should be."""
    ratio = ratio.copy()
    for j in range(ratio.shape[-1]):
        own = ratio[..., j][told[..., j]]
        ratio[..., j] /= max(1.4826 * float(np.median(np.abs(own))) if len(own) else 1.0, 1.0)
    return ratio


def pushes(found: Scan, segments: Segments, rig: Situation) -> Sequence[tuple[ExternalPulse, float]]:
    """Pushes that stand out, one effect a joint, and about how many nats they could gain."""
    limit = float(norm.isf(_LEVEL / 2 / max(found.ratio.size, 1)))
    effects = []
    for j, joint in enumerate(rig.joints):
        pulses: list[tuple[float, Pulse]] = []
        for s in range(found.ratio.shape[0]):
            pulses += _in_segment(found, segments, s, j, limit)
        joined = _joined(sorted(pulses, key=lambda item: (item[1].episode, item[1].begin)))
        strongest = sorted(joined, key=lambda item: -abs(item[0]))[:_MOST]
        if strongest:
            ordered = sorted((p for _, p in strongest), key=lambda p: (p.episode, p.begin))
            told = np.abs(found.ratio[..., j])
            effects.append((ExternalPulse(joint, ordered), float(0.5 * np.sum(told[told > limit] ** 2))))
    return effects


def _in_segment(found: Scan, segments: Segments, s: int, j: int, limit: float) -> list[tuple[float, Pulse]]:
    """Runs of windows that stand out, those beside them that lean the same way, and how much (signed)."""
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


def _joined(pulses: Sequence[tuple[float, Pulse]]) -> list[tuple[float, Pulse]]:
    """Pulses the same way that touch, as where a segment ends, are one."""
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
