"""Columns for errors of the nominal model's laws, reduced to the shapes that the data can identify."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations
from slapshot.diagnosis.fit.linear import Perturbation, linearise
from slapshot.diagnosis.fit.noise import LARGEST_LAW_ERROR, Noise
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.segments import Segments

# Minimum information on a mixture of shapes at the largest error, relative to its prior: mixtures below it
# are not identifiable.
_MIN_INFORMATION = 0.1
_MAX_COLUMNS = 400
_LOW_FORCE = 1e-5  # low process force, which maximises the information


@dataclass(frozen=True)
class LawColumns:
    """Mixtures of the shapes of law errors, each of unit size.

    Attributes:
        laws: perturbations for the shapes of each law.
        mixtures: (shapes, k) for each law.
        information: (k,) for each law, on each mixture at the largest law error.
        W: (S, L, dim, k of all) their columns along the trajectory that they were chosen on.
        torque: (nv,) scale of forces.
    """

    laws: tuple[Sequence[Perturbation], ...]
    mixtures: tuple[Array, ...]
    information: tuple[Array, ...]
    W: Array
    torque: Array

    def identifiable_at(self, law_error: float) -> "LawColumns":
        """The mixtures that are identifiable at a given size of law errors."""
        least = _MIN_INFORMATION * (LARGEST_LAW_ERROR / law_error) ** 2
        keep = [values > least for values in self.information]
        return LawColumns(
            self.laws,
            tuple(mixture[:, information] for mixture, information in zip(self.mixtures, keep, strict=True)),
            tuple(values[information] for values, information in zip(self.information, keep, strict=True)),
            np.ascontiguousarray(self.W[..., np.concatenate([np.zeros(0, bool), *keep])]),
            self.torque,
        )

    def on(
        self,
        simulator: Simulator,
        hypothesis: Hypothesis,
        theta: Array,
        segments: Segments,
        trajectory: Array,
    ) -> Array:
        """The same columns along another trajectory, (S, L, dim, k)."""
        columns = [np.zeros((*segments.shape, simulator.tangent.dim, 0))]
        for perturbations, mixture in zip(self.laws, self.mixtures, strict=True):
            W, _ = _law_columns(
                simulator, hypothesis, theta, segments, trajectory, perturbations, self.torque
            )
            columns.append(W @ mixture)
        return np.concatenate(columns, axis=-1)


def law_columns(
    simulator: Simulator,
    segments: Segments,
    trajectory: Array,
    torque: Array,
    laws: Sequence[Sequence[Perturbation]],
    noise: Noise,
) -> LawColumns:
    """The mixtures of shapes with the most information.

    Args:
        simulator: of the nominal rig.
        segments: data.
        trajectory: (S, L, nx).
        torque: (nv,) scale of forces.
        laws: perturbations for the shapes of each law.
        noise: approximate noise of the data.
    """
    hypothesis = Hypothesis(simulator.rig)
    quiet = replace(noise, force=_LOW_FORCE).covariances(segments.interval)
    found: list[tuple[Array, Array, Array]] = []
    for perturbations in laws:
        W, system = _law_columns(
            simulator, hypothesis, np.zeros(0), segments, trajectory, perturbations, torque
        )
        seen = innovations(system.with_columns(W, np.zeros((*system.r.shape, len(perturbations)))), quiet)
        z = LARGEST_LAW_ERROR * seen.Z.reshape(seen.e.size, -1)
        found.append((*np.linalg.eigh(z.T @ z), W))
    largest = np.sort(np.concatenate([np.zeros(1), *(values for values, *_ in found)]))[::-1]
    least = max(_MIN_INFORMATION, float(largest[min(_MAX_COLUMNS, len(largest) - 1)]))
    mixtures = [vectors[:, values > least] for values, vectors, _ in found]
    information = tuple(values[values > least] for values, *_ in found)
    empty = np.zeros((*segments.shape, simulator.tangent.dim, 0))
    columns = [W @ mixture for (*_, W), mixture in zip(found, mixtures, strict=True)]
    W = np.concatenate([empty, *columns], axis=-1)
    return LawColumns(tuple(laws), tuple(mixtures), information, W, torque)


def _law_columns(
    simulator: Simulator,
    hypothesis: Hypothesis,
    theta: Array,
    segments: Segments,
    trajectory: Array,
    perturbations: Sequence[Perturbation],
    torque: Array,
) -> tuple[Array, Linear]:
    """Columns of one law in units of their priors, and the system without them."""
    system = linearise(
        simulator, hypothesis, theta, segments, trajectory, perturbations, torque_scale=torque
    ).system
    own = system.W[..., len(theta) :] * [perturbation.scale for perturbation in perturbations]
    return own, system.without_columns()
