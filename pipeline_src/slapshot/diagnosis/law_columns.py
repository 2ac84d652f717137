"""Columns of the errors of the nominal model's laws: as many of their shapes as the data can tell apart."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.filter import Linear, innovations
from slapshot.diagnosis.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.linear import Look, linearise
from slapshot.diagnosis.noise import LARGEST_LAW_ERROR, Noise
from slapshot.diagnosis.segments import Segments

# Information on a mixture of shapes at the largest error, over that of its prior, below which it is left out:
# then its size is not told from none.
_LEAST = 0.1
_MOST = 400
_QUIET = 1e-5  # process force, of which less means that more is told


@dataclass(frozen=True)
class LawColumns:
    """Mixtures of the shapes in which laws may err, each of unit size.

    Attributes:
        laws: looks at the shapes of each law.
        mixtures: (shapes, k) for each law.
        information: (k,) for each law, what the data tell of each mixture at the largest error of laws.
        W: (S, L, dim, k of all) their columns along the path that they were chosen on.
    """

    laws: tuple[Sequence[Look], ...]
    mixtures: tuple[Array, ...]
    information: tuple[Array, ...]
    W: Array

    def told_at(self, law_error: float) -> "LawColumns":
        """Those that the data can tell from none where laws err by so much."""
        least = _LEAST * (LARGEST_LAW_ERROR / law_error) ** 2
        keep = [values > least for values in self.information]
        return LawColumns(
            self.laws,
            tuple(mixture[:, told] for mixture, told in zip(self.mixtures, keep, strict=True)),
            tuple(values[told] for values, told in zip(self.information, keep, strict=True)),
            np.ascontiguousarray(self.W[..., np.concatenate([np.zeros(0, bool), *keep])]),
        )

    def on(
        self, simulator: Simulator, hypothesis: Hypothesis, theta: Array, segments: Segments, path: Array
    ) -> Array:
        """The same columns along another path, (S, L, dim, k)."""
        columns, known = [np.zeros((*segments.shape, simulator.tangent.dim, 0))], None
        for looks, mixture in zip(self.laws, self.mixtures, strict=True):
            W, known = _raw(simulator, hypothesis, theta, segments, path, looks, None, known)
            columns.append(W @ mixture)
        return np.concatenate(columns, axis=-1)


def law_columns(
    simulator: Simulator,
    segments: Segments,
    path: Array,
    torque: Array,
    laws: Sequence[Sequence[Look]],
    noise: Noise,
) -> LawColumns:
    """The mixtures of shapes that the data tell most of.

    Args:
        simulator: of the nominal rig.
        segments: data.
        path: (S, L, nx).
        torque: (nv,) scale of forces.
        laws: looks at the shapes of each law.
        noise: about that of the data.
    """
    hypothesis, known = Hypothesis(simulator.rig), None
    quiet = replace(noise, force=_QUIET).covariances(segments.interval)
    found: list[tuple[Array, Array, Array]] = []
    for looks in laws:
        W, known = _raw(simulator, hypothesis, np.zeros(0), segments, path, looks, torque, known)
        seen = innovations(known.with_columns(W, np.zeros((*known.r.shape, len(looks)))), quiet)
        z = LARGEST_LAW_ERROR * seen.Z.reshape(seen.e.size, -1)
        found.append((*np.linalg.eigh(z.T @ z), W))
    largest = np.sort(np.concatenate([np.zeros(1), *(values for values, *_ in found)]))[::-1]
    least = max(_LEAST, float(largest[min(_MOST, len(largest) - 1)]))
    mixtures = [vectors[:, values > least] for values, vectors, _ in found]
    told = tuple(values[values > least] for values, *_ in found)
    empty = np.zeros((*segments.shape, simulator.tangent.dim, 0))
    columns = [W @ mixture for (*_, W), mixture in zip(found, mixtures, strict=True)]
    return LawColumns(tuple(laws), tuple(mixtures), told, np.concatenate([empty, *columns], axis=-1))


def _raw(
    simulator: Simulator,
    hypothesis: Hypothesis,
    theta: Array,
    segments: Segments,
    path: Array,
    looks: Sequence[Look],
    torque: Array | None,
    known: Linear | None,
) -> tuple[Array, Linear]:
    """Columns of one law in units of their priors, and the system without them."""
    system = linearise(
        simulator, hypothesis, theta, segments, path, looks, torque_scale=torque, jacobian=known
    ).system
    own = system.W[..., len(theta) :] * [look.scale for look in looks]
    return own, system.without_columns()
