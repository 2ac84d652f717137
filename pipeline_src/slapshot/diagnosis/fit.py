"""Fit the parameters of a hypothesis and the path, the noise being given.

Gauss-Newton on both: every round linearises about the path, moves the parameters (nuisance columns, such as
law errors, are integrated out), and smooths the path under the moved parameters. A fit converges when no
parameter moves by more than a hundredth of its posterior standard deviation; one that does not says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.filter import Linear, innovations, smooth
from slapshot.diagnosis.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.law_error import knees, own_law_errors, presliding
from slapshot.diagnosis.linear import Linearised, Look, linearise
from slapshot.diagnosis.noise import ADDED, DRIFT, NOMINAL, Noise, Prior, log_likelihood
from slapshot.diagnosis.segments import Segments
from slapshot.effects.joints.effect import Situation, State

# Posterior standard deviations that values may move until derivatives are taken anew.
_NEARLY, _FAR = 0.3, 3.0
_DROP = 0.05  # share of its evidence that a step may lose: each is judged by a linearisation of its own
_SMALLEST = 1e-3  # share of a step that is still tried
_DIGITS = 1e-6
STILL = 0.01  # posterior standard deviations that parameters may still move
SETTLED = 0.1  # the same, where rounds have run out


def prior_of(hypothesis: Hypothesis, looks: Sequence[Look]) -> Prior:
    """Priors of the columns that linearising gives."""
    sd = np.concatenate([hypothesis.prior_sd, [look.scale for look in looks]])
    return Prior.of(sd)


@dataclass(frozen=True)
class Fit:
    """A hypothesis fitted to segments.

    Attributes:
        hypothesis: what was fitted.
        theta: (p,) values.
        path: (S, L, nx) smoothed states.
        log_evidence: Laplace approximation of the log marginal likelihood, without constants.
        precision: (p, p) inverse of the posterior covariance of the values.
        converged: whether the values came to rest.
        moved: by how many posterior standard deviations they moved in the last round.
    """

    hypothesis: Hypothesis
    theta: Array
    path: Array
    log_evidence: float
    precision: Array
    converged: bool
    moved: float

    @property
    def settled(self) -> bool:
        """Whether the values are found: they may still move by a little of what they are uncertain by."""
        return self.converged or not len(self.theta) or self.moved < SETTLED

    @property
    def sd(self) -> Array:
        """(p,) posterior standard deviations."""
        return np.sqrt(np.diag(np.linalg.inv(self.precision))) if len(self.theta) else np.zeros(0)


@dataclass(frozen=True)
class Fitter:
    """Fits hypotheses on one rig to one set of segments.

    Attributes:
        simulator: of the rig.
        segments: data.
        torque: (nv,) scale of forces.
        nuisance: columns that are integrated out of every hypothesis.
        law_errors: (S, L, n, k) further ones, of errors of the nominal model's laws; None for none.
        drifts: (S, k) shapes of drift over the session, which every channel may have; None for none.
        rig: scales, for errors of the laws that a hypothesis adds; None leaves them out.
    """

    simulator: Simulator
    segments: Segments
    torque: Array
    nuisance: tuple[Look, ...] = ()
    rig: Situation | None = None
    law_errors: Array | None = None
    drifts: Array | None = None

    def select(self, segments: NDArray[np.intp]) -> "Fitter":
        """The same for some segments."""
        laws = None if self.law_errors is None else self.law_errors[segments]
        drifts = None if self.drifts is None else self.drifts[segments]
        return replace(self, segments=self.segments.select(segments), law_errors=laws, drifts=drifts)

    def system(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        path: Array,
        looks: Sequence[Look] = (),
        jacobian: Linear | None = None,
    ) -> tuple[Linear, Prior]:
        """The linear system of a hypothesis with all nuisance, and the priors of its columns.

        Columns are those of the hypothesis' parameters, the nuisance, the looks, drift of the readings, and
        errors of the nominal model's laws and of those that the hypothesis adds.
        """
        everything = (*self.nuisance, *looks)
        found = self.linearise(hypothesis, theta, path, everything, jacobian)
        system, prior = found.system, prior_of(hypothesis, everything)
        more: list[tuple[Prior, Array | None, Array | None]] = []
        if self.drifts is not None:
            S, _, ny, _ = system.psi.shape
            turns = [c for columns in self.simulator.rig.quaternions for c in columns]
            channels = np.setdiff1d(np.arange(ny), turns)
            psi = np.einsum("sk,cd->scdk", self.drifts, np.eye(ny)[:, channels]).reshape(S, 1, ny, -1)
            of_drift = Prior.of(np.ones(psi.shape[-1]), DRIFT, np.repeat(channels, self.drifts.shape[1]))
            more.append((of_drift, None, psi))
        if self.law_errors is not None:
            more.append((Prior.of(np.ones(self.law_errors.shape[-1]), NOMINAL), self.law_errors, None))
        if self.rig is not None:
            nq, nv = self.simulator.tangent.nq, self.simulator.tangent.nv
            x = path.reshape(-1, path.shape[-1])
            order = np.repeat(self.segments.order, self.segments.shape[1])
            torque = found.torque.reshape(len(x), nv)
            state = State(x[:, :nq], x[:, nq : nq + nv], torque, self.segments.time.reshape(-1), order)
            W = own_law_errors(system, hypothesis, theta, self.rig, state, self.segments.interval)
            more.append((Prior.of(np.ones(W.shape[-1]), ADDED), W, None))
            W = presliding(system, hypothesis, theta, self.rig, state, self.segments.interval)
            more.append((Prior.of(np.ones(W.shape[-1])), W, None))
            W = knees(system, hypothesis, theta, x, self.segments)
            more.append((Prior.of(np.ones(W.shape[-1])), W, None))
        return _wider(system, prior, more)

    def linearise(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        path: Array,
        looks: Sequence[Look] = (),
        jacobian: Linear | None = None,
    ) -> Linearised:
        """Linearise on these segments."""
        return linearise(
            self.simulator, hypothesis, theta, self.segments, path, looks,
            torque_scale=self.torque, jacobian=jacobian,
        )  # fmt: skip

    def fit(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        path: Array,
        noise: Noise,
        rounds: int = 8,
        known: Linear | None = None,
    ) -> Fit:
        """Fit from a start.

        Args:
            hypothesis: what to fit.
            theta: first values.
            path: first path.
            noise: that of the data.
            rounds: at most.
            known: a system about the first path, or one near it, whose derivatives serve for the first round.
        """
        p = len(hypothesis.parameters)
        theta, start = hypothesis.within(theta), hypothesis.start
        covariances = noise.covariances(self.segments.interval)
        moved, converged, evidence = np.inf, False, -np.inf
        before: tuple[float, Array, Array] | None = None
        step: Array = np.zeros(p)
        delta, share = np.zeros((*path.shape[:2], self.simulator.tangent.dim)), 1.0
        system, since = known, np.inf if known is None else 0.0
        precision = np.diag(hypothesis.prior_sd**-2.0)
        for number in range(rounds + 1):
            # Derivatives hardly change along the way: they are taken anew where values have moved since.
            fresh = system is None or since > (_NEARLY if converged or number == rounds else _FAR)
            reused = None if fresh else system
            system, prior = self.system(hypothesis, theta, path, jacobian=reused)
            since = 0.0 if fresh else since
            sd = prior.at(noise)
            seen = innovations(system, covariances)
            z = seen.Z.reshape(seen.e.size, -1) * sd
            offset = np.zeros(len(sd))
            offset[:p] = (theta - start) / sd[:p]
            gradient = z.T @ seen.e.reshape(-1) - offset
            scaled = np.eye(len(sd)) + z.T @ z
            full = np.zeros(len(sd))
            evidence = -np.inf
            if np.all(np.isfinite(scaled)) and np.all(np.isfinite(gradient)):
                full = np.asarray(np.linalg.solve(scaled, gradient))
                # More than there is cannot be explained: then the numbers have lost their digits.
                if gradient @ full < (1 + _DIGITS) * (np.sum(seen.e**2) + offset @ offset):
                    full = possible(hypothesis, theta, full, sd, scaled)
                    evidence = float(
                        log_likelihood(seen) - 0.5 * offset @ offset + gradient @ full
                        - 0.5 * full @ scaled @ full - 0.5 * np.linalg.slogdet(scaled)[1]
                    )  # fmt: skip
            if before is not None and evidence < before[0] - _DROP * abs(before[0]):
                if number == rounds or share < _SMALLEST:
                    evidence, theta, path = before
                    converged = False
                    break
                # The step went too far.
                share /= 4
                theta = before[1] + share * step
                path = self.simulator.tangent.add(before[2], share * delta)
                continue
            if not np.isfinite(evidence):
                break
            # Precision of the values alone: the nuisance is eliminated (Schur complement).
            own, other = scaled[:p, :p], scaled[:p, p:]
            own = own - other @ np.linalg.solve(scaled[p:, p:], other.T)
            precision = own / np.outer(sd[:p], sd[:p])
            if converged or number == rounds:
                break
            before, share = (evidence, theta, path), 1.0
            full = full * sd
            target, step = hypothesis.within(theta + full[:p]), full[:p]
            delta, *_ = smooth(system.moved(full).without_columns(), covariances)
            spread = np.sqrt(np.diag(np.linalg.inv(precision))) if p else np.zeros(0)
            moved = float(np.max(np.abs(step) / spread, initial=0.0))
            theta, path = target, self.simulator.tangent.add(path, delta)
            since += moved
            converged = moved < STILL and number >= 1
        return Fit(hypothesis, theta, path, evidence, precision, converged, moved)


def possible(hypothesis: Hypothesis, theta: Array, full: Array, sd: Array, scaled: Array) -> Array:
    """A step towards values that are possible, all others being the best beside those at their limits."""
    p = len(theta)
    step = (hypothesis.within(theta + full[:p] * sd[:p]) - theta) / sd[:p]
    held = np.flatnonzero(np.abs(step - full[:p]) > _DIGITS)
    if not len(held):
        return full
    rest = np.setdiff1d(np.arange(len(full)), held)
    # What the others do of their own accord, and what they do since these are held elsewhere.
    moved = full.copy()
    moved[held] = step[held]
    further = scaled[np.ix_(rest, held)] @ (moved - full)[held]
    moved[rest] -= np.linalg.solve(scaled[np.ix_(rest, rest)], further)
    moved[:p] = (hypothesis.within(theta + moved[:p] * sd[:p]) - theta) / sd[:p]
    return moved


def _wider(
    system: Linear, prior: Prior, more: Sequence[tuple[Prior, Array | None, Array | None]]
) -> tuple[Linear, Prior]:
    """A system with columns more, each with its W and psi; where there is none, they change nothing."""
    first = len(prior.sd)
    for added, *_ in more:
        prior = prior.and_of(added)
    if len(prior.sd) == first:
        return system, prior
    W = np.zeros((*system.W.shape[:3], len(prior.sd)))
    psi = np.zeros((*system.psi.shape[:3], len(prior.sd)))
    W[..., :first], psi[..., :first] = system.W, system.psi
    for added, own, seen in more:
        columns = slice(first, first + len(added.sd))
        if own is not None:
            W[..., columns] = own
        if seen is not None:
            psi[..., columns] = seen
        first = columns.stop
    return system.with_columns(W, psi), prior
