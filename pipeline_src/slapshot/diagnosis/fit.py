"""Fit the parameters of a hypothesis, the path and the noise together.

Gauss-Newton on all of it: every round linearises about the path, moves the parameters, and smooths the path under
the moved parameters. A fit converges when no parameter moves by more than a hundredth of its posterior standard
deviation; one that does not says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.filter import innovations, smooth
from slapshot.diagnosis.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.linear import Linearised, linearise
from slapshot.diagnosis.noise import Noise, fit_noise, log_likelihood
from slapshot.diagnosis.segments import Segments

Array = NDArray[np.float64]

STILL = 0.01  # posterior standard deviations that parameters may still move
_HALVINGS = 6


@dataclass(frozen=True)
class Fit:
    """A hypothesis fitted to segments.

    Attributes:
        hypothesis: what was fitted.
        theta: values.
        path: (S, L, nx) smoothed states.
        noise: of this model.
        log_likelihood: of the observations, without constants.
        log_prior: of the values.
        information: (p, p) of the data about the values.
        converged: whether the values came to rest.
        moved: by how many posterior standard deviations they moved in the last round.
    """

    hypothesis: Hypothesis
    theta: Array
    path: Array
    noise: Noise
    log_likelihood: float
    log_prior: float
    information: Array
    converged: bool
    moved: float

    @property
    def covariance(self) -> Array:
        """(p, p) posterior covariance of the values."""
        return np.linalg.inv(self.information + np.diag(1 / self.hypothesis.prior_sd**2))

    @property
    def sd(self) -> Array:
        """(p,) posterior standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def log_evidence(self) -> float:
        """Laplace approximation of the log marginal likelihood, without constants."""
        scaled = self.information * np.outer(self.hypothesis.prior_sd, self.hypothesis.prior_sd)
        volume = 0.5 * np.linalg.slogdet(np.eye(len(self.theta)) + scaled)[1]
        return float(self.log_likelihood + self.log_prior - volume)


@dataclass(frozen=True)
class Fitter:
    """Fits hypotheses on one rig to one set of segments.

    Attributes:
        simulator: of the rig.
        segments: data.
        kinds: quantity of each channel.
        torque: (nv,) scale of forces.
    """

    simulator: Simulator
    segments: Segments
    kinds: Sequence[str]
    torque: Array
    fixed_noise: bool = field(default=False)

    def fit(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        path: Array,
        noise: Noise,
        *,
        rounds: int = 8,
        colour: bool = True,
    ) -> Fit:
        """Fit from a start.

        Args:
            hypothesis: what to fit.
            theta: first values.
            path: first path.
            noise: first noise.
            rounds: at most.
            colour: whether coloured noise may be there.
        """
        theta = hypothesis.within(theta)
        moved, converged = np.inf, False
        best: tuple[float, Array, Array] | None = None
        information = np.zeros((len(theta), len(theta)))
        for number in range(rounds):
            found = self.linearise(hypothesis, theta, path)
            if number < 2 or number == rounds - 1 or (number % 3 == 0):
                noise = fit_noise(found.system, noise, self.segments, self.kinds, colour=colour)
            covariances = noise.covariances(self.segments.interval)
            seen = innovations(found.system, covariances)
            z = seen.Z.reshape(seen.e.size, len(theta))
            information = z.T @ z
            prior = 1 / hypothesis.prior_sd**2
            gradient = z.T @ seen.e.reshape(-1) - prior * (theta - hypothesis.start)
            precision = information + np.diag(prior)
            step = np.linalg.solve(precision, gradient) if len(theta) else np.zeros(0)
            target = hypothesis.within(theta + step)
            step = target - theta
            delta, _ = smooth(found.system.moved(step).without_columns(), covariances)
            path_step = float(np.sqrt(np.mean(delta**2)))
            sd = np.sqrt(np.diag(np.linalg.inv(precision))) if len(theta) else np.ones(0)
            moved = float(np.max(np.abs(step) / sd, initial=0.0))
            theta, path = target, self.simulator.tangent.add(path, delta)
            if not np.all(np.isfinite(path)):
                break
            converged = moved < STILL and number > 0
            if converged and (len(theta) or number >= 2) and path_step < np.inf:
                break
        found = self.linearise(hypothesis, theta, path)
        covariances = noise.covariances(self.segments.interval)
        seen = innovations(found.system, covariances)
        z = seen.Z.reshape(seen.e.size, len(theta))
        log_prior = float(-0.5 * np.sum(((theta - hypothesis.start) / hypothesis.prior_sd) ** 2))
        return Fit(hypothesis, theta, path, noise, log_likelihood(seen), log_prior, z.T @ z, converged, moved)

    def linearise(
        self, hypothesis: Hypothesis, theta: Array, path: Array, looks: Sequence = ()
    ) -> Linearised:
        """Linearise on these segments."""
        return linearise(
            self.simulator, hypothesis, theta, self.segments, path, looks, torque_scale=self.torque
        )
