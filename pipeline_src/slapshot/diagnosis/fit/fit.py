"""Fit the parameters of a hypothesis and the trajectory for given noise.

Gauss-Newton on both: every round linearises about the trajectory, moves the parameters (nuisance columns,
such as law errors, are integrated out), and smooths the trajectory under the moved parameters. A fit has
converged when no parameter moves by more than a hundredth of its posterior standard deviation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear, innovations, smooth
from slapshot.diagnosis.fit.law_error import GAIN_ERROR, added_law_errors, friction_at_rest, soft_limit
from slapshot.diagnosis.fit.linear import Linearised, Perturbation, linearise
from slapshot.diagnosis.fit.noise import ADDED, DRIFT, NOMINAL, Noise, Prior, log_likelihood
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.effect import RigMotion, State

# Movement of values, in posterior standard deviations, after which derivatives are recomputed.
_NEAR, _FAR = 0.3, 3.0
# Share of the evidence, and nats, that a step may lose, since every step has its own linearisation.
_MAX_LOSS, _MAX_LOSS_NATS = 0.05, 100.0
_MOST_SHORTENED = 5  # quarters of a step that are tried
_LEAST_SHRUNK = 0.7  # share of what a step loses that a quarter of it may lose and a further one is tried
_DIGITS = 1e-6
_PATIENCE = 3  # factor on the rounds of a fit that is close and not yet settled
_CLOSE_SD = 1.0  # of a step, in posterior standard deviations, whose evidence counts
_LEAST_DAMPING = 1 / 8  # of steps that turn back
CONVERGED_SD = 0.01  # convergence: movement of parameters in posterior standard deviations
SETTLED_SD = 0.1  # the same, when the rounds are used up


def prior_of(hypothesis: Hypothesis, perturbations: Sequence[Perturbation]) -> Prior:
    """Priors of the columns of a linearisation."""
    sd = np.concatenate([hypothesis.prior_sd, [perturbation.scale for perturbation in perturbations]])
    return Prior.of(sd)


@dataclass(frozen=True)
class Fit:
    """A hypothesis fitted to segments.

    Attributes:
        hypothesis: what was fitted.
        theta: (p,) values.
        trajectory: (S, L, nx) smoothed states.
        log_evidence: Laplace approximation of the log marginal likelihood, without constants.
        precision: (p, p) inverse of the posterior covariance of the values.
        converged: whether the values converged.
        moved: their last movement, in posterior standard deviations.
    """

    hypothesis: Hypothesis
    theta: Array
    trajectory: Array
    log_evidence: float
    precision: Array
    converged: bool
    moved: float

    @property
    def settled(self) -> bool:
        """Whether the values converged, or moved by little relative to their uncertainty."""
        return self.converged or not len(self.theta) or self.moved < SETTLED_SD

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
        law_errors: (S, L, n, k) columns for errors of the nominal model's laws; None for none.
        drifts: (S, k) shapes of drift over the session, for every channel; None for none.
        rig: scales for errors of added laws; None omits these.
    """

    simulator: Simulator
    segments: Segments
    torque: Array
    nuisance: tuple[Perturbation, ...] = ()
    rig: RigMotion | None = None
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
        trajectory: Array,
        perturbations: Sequence[Perturbation] = (),
        jacobian: Linear | None = None,
    ) -> tuple[Linear, Prior]:
        """The linear system of a hypothesis with all nuisance, and the priors of its columns.

        Columns are those of the hypothesis' parameters, the nuisance, the perturbations, drift of the
        readings, and errors of the nominal model's laws and of those that the hypothesis adds.
        """
        everything = (*self.nuisance, *perturbations)
        found = self.linearise(hypothesis, theta, trajectory, everything, jacobian)
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
            x = trajectory.reshape(-1, trajectory.shape[-1])
            order = np.repeat(self.segments.order, self.segments.shape[1])
            torque = found.torque.reshape(len(x), nv)
            state = State(x[:, :nq], x[:, nq : nq + nv], torque, self.segments.time.reshape(-1), order)
            W = added_law_errors(system, hypothesis, theta, self.rig, state, self.segments.interval)
            more.append((Prior.of(np.ones(W.shape[-1]), ADDED), W, None))
            system = replace(system, at_rest=friction_at_rest(system, hypothesis, theta, self.rig, state))
            W = soft_limit(system, hypothesis, theta, x, self.segments)
            more.append((Prior.of(np.ones(W.shape[-1])), W, None))
        return _append_columns(system, prior, more)

    def linearise(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        trajectory: Array,
        perturbations: Sequence[Perturbation] = (),
        jacobian: Linear | None = None,
    ) -> Linearised:
        """Linearise on these segments."""
        return linearise(
            self.simulator, hypothesis, theta, self.segments, trajectory, perturbations,
            torque_scale=self.torque, jacobian=jacobian,
        )  # fmt: skip

    def fit(
        self,
        hypothesis: Hypothesis,
        theta: Array,
        trajectory: Array,
        noise: Noise,
        rounds: int = 8,
        known: Linear | None = None,
        patient: bool = False,
    ) -> Fit:
        """Fit from a start.

        Args:
            hypothesis: what to fit.
            theta: first values.
            trajectory: first trajectory.
            noise: that of the data.
            rounds: at most, or thrice as many where it is close, but not yet settled.
            known: a system about the first trajectory, or one near it, whose derivatives serve for the first
                round.
            patient: whether derivatives are computed anew in each further round, and the fit has settled when
                its damped steps are small, as across kinks of dry friction.
        """
        p = len(hypothesis.parameters)
        theta, start = hypothesis.clipped(theta), hypothesis.start
        covariances = noise.covariances(self.segments.interval)
        moved, converged, evidence = np.inf, False, -np.inf
        before: tuple[float, Array, Array] | None = None
        best: tuple[float, Array, Array, Array, float] | None = None
        laws = np.array([effect.empirical for effect in hypothesis.effects for _ in effect.parameters], bool)
        step: Array = np.zeros(p)
        last, damping = step, 1.0
        delta, share = np.zeros((*trajectory.shape[:2], self.simulator.tangent.dim)), 1.0
        system, since = known, np.inf if known is None else 0.0
        precision = np.diag(hypothesis.prior_sd**-2.0)
        number, shortened, most, lost = 0, 0, rounds, np.inf
        while True:
            # Derivatives change slowly: they are recomputed only after the values have moved; a patient fit
            # that uses up its rounds does so anew each time, since joints stop and start at other nodes.
            near = _NEAR if converged or number == most else _FAR
            fresh = system is None or since > near or shortened > 0 or (patient and number > rounds)
            reused = None if fresh else system
            system, prior = self.system(hypothesis, theta, trajectory, jacobian=reused)
            since = 0.0 if fresh else since
            sd = prior.at(noise)
            seen = innovations(system, covariances)
            z, e = seen.Z.reshape(seen.e.size, -1), seen.e.reshape(-1)
            squares = (z.T @ z) * np.outer(sd, sd)
            apart = _law_errors_apart(squares, prior, laws)
            offset = np.zeros(len(sd))
            offset[:p] = (theta - start) / sd[:p]
            gradient = apart.T @ (sd * (z.T @ e)) - offset
            scaled = np.eye(len(sd)) + apart.T @ squares @ apart
            full = np.zeros(len(sd))
            evidence = -np.inf
            if np.all(np.isfinite(scaled)) and np.all(np.isfinite(gradient)):
                full = np.asarray(np.linalg.solve(scaled, gradient))
                # More cannot be explained than there is: otherwise the result is numerically invalid.
                if gradient @ full < (1 + _DIGITS) * (np.sum(seen.e**2) + offset @ offset):
                    full = project_to_bounds(hypothesis, theta, full, sd, scaled)
                    evidence = float(
                        log_likelihood(seen) + noise.log_prior - 0.5 * offset @ offset + gradient @ full
                        - 0.5 * full @ scaled @ full - 0.5 * np.linalg.slogdet(scaled)[1]
                    )  # fmt: skip
            if before is not None and evidence < before[0] - min(_MAX_LOSS * abs(before[0]), _MAX_LOSS_NATS):
                if not fresh:
                    # Where joints stop or start, derivatives change at once.
                    since = np.inf
                    continue
                # What a step is too long by shrinks with it; what derivatives of elsewhere promised does not.
                given_up, lost = before[0] - evidence > _LEAST_SHRUNK * lost, before[0] - evidence
                if shortened == _MOST_SHORTENED or given_up:
                    evidence, theta, trajectory = before
                    converged = False
                    break
                # The step was too long.
                share, shortened = share / 4, shortened + 1
                theta = before[1] + share * step
                trajectory = self.simulator.tangent.add(before[2], share * delta)
                continue
            if not np.isfinite(evidence):
                break
            # Precision of the values alone: the nuisance is eliminated (Schur complement).
            own, other = scaled[:p, :p], scaled[:p, p:]
            own = own - other @ np.linalg.solve(scaled[p:, p:], other.T)
            precision = _with_gain_errors(own / np.outer(sd[:p], sd[:p]), prior, noise, theta * laws)
            if number == rounds and SETTLED_SD < moved < _CLOSE_SD:
                most = _PATIENCE * rounds
            if converged or number == most or (patient and number > rounds and moved < SETTLED_SD):
                break
            before, share, shortened, number = (evidence, theta, trajectory), 1.0, 0, number + 1
            lost = np.inf
            delta, *_ = smooth(system.moved(apart @ full * sd).without_columns(), covariances)
            full = full * sd
            spread = np.sqrt(np.diag(np.linalg.inv(precision))) if p else np.zeros(0)
            newton = float(np.max(np.abs(full[:p]) / spread, initial=0.0))
            # Far from its optimum a linearisation says nothing about the evidence.
            if newton < _CLOSE_SD and (best is None or evidence > best[0]):
                best = evidence, theta, trajectory, precision, newton
            if newton < _CLOSE_SD and last @ precision @ full[:p] < 0:
                damping = max(damping / 2, _LEAST_DAMPING)  # to and fro across a kink, as of dry friction
            last, step, delta = full[:p], damping * full[:p], damping * delta
            theta = hypothesis.clipped(theta + step)
            trajectory = self.simulator.tangent.add(trajectory, delta)
            since += damping * newton
            moved = damping * newton if patient and number > rounds else newton
            converged = newton < CONVERGED_SD and number > 1
        if best is not None and moved > SETTLED_SD and (moved > _CLOSE_SD or evidence < best[0]):
            evidence, theta, trajectory, precision, moved = best
        return Fit(hypothesis, theta, trajectory, evidence, precision, converged, moved)


def project_to_bounds(hypothesis: Hypothesis, theta: Array, full: Array, sd: Array, scaled: Array) -> Array:
    """Project a step onto the bounds, and re-optimise all other values."""
    p = len(theta)
    step = (hypothesis.clipped(theta + full[:p] * sd[:p]) - theta) / sd[:p]
    held = np.flatnonzero(np.abs(step - full[:p]) > _DIGITS)
    if not len(held):
        return full
    rest = np.setdiff1d(np.arange(len(full)), held)
    # The free step of the others, and its correction for the values held at bounds.
    moved = full.copy()
    moved[held] = step[held]
    further = scaled[np.ix_(rest, held)] @ (moved - full)[held]
    moved[rest] -= np.linalg.solve(scaled[np.ix_(rest, rest)], further)
    moved[:p] = (hypothesis.clipped(theta + moved[:p] * sd[:p]) - theta) / sd[:p]
    return moved


def _law_errors_apart(squares: Array, prior: Prior, laws: NDArray[np.bool_]) -> Array:
    """Columns in which errors of laws leave the sizes of laws alone.

    What an error of a law has in common with the laws themselves is a matter of definition: here their sizes
    are those that fit best without errors (as a computer model's parameters in Plumlee 2017, Journal of the
    American Statistical Association 112(519)). Otherwise errors that vary with speed and load could stand in
    for any of a joint's frictions, and a size would be that for which errors are least, far from what a
    regression finds.

    Args:
        squares: (columns, columns) products of the whitened columns, in standard deviations.
        prior: of the columns.
        laws: which of the first columns are parameters of laws.

    Returns:
        (columns, columns) the new columns as combinations of those that are given.
    """
    apart = np.eye(len(squares))
    of, own = np.flatnonzero(np.isin(prior.kind, (NOMINAL, ADDED))), np.flatnonzero(laws)
    if len(own) and len(of) and np.all(np.isfinite(squares)):
        known = squares[np.ix_(own, own)] + np.eye(len(own))
        apart[np.ix_(own, of)] = -np.linalg.solve(known, squares[np.ix_(own, of)])
    return apart


def _with_gain_errors(precision: Array, prior: Prior, noise: Noise, sizes: Array) -> Array:
    """The precision of values where laws that err in shape err by a smaller share as a whole, too.

    Args:
        precision: (p, p) without that.
        prior: of all columns.
        noise: with the size of errors of laws.
        sizes: (p,) values of parameters of laws; 0 for others.
    """
    if not sizes.any():
        return precision
    errors = (NOMINAL, noise.law_error), (ADDED, noise.added_error)
    square = sum(size**2 for kind, size in errors if np.any(prior.kind == kind))
    return np.asarray(np.linalg.inv(np.linalg.inv(precision) + np.diag(GAIN_ERROR**2 * square * sizes**2)))


def _append_columns(
    system: Linear, prior: Prior, more: Sequence[tuple[Prior, Array | None, Array | None]]
) -> tuple[Linear, Prior]:
    """A system with further columns, each with its W and psi, where None is zero."""
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
