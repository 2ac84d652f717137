"""Fit by multiple shooting: every segment is simulated from its own initial state, without process force.

Backlash and stick-slip cannot be linearised about a smoothed trajectory. Simulation over whole segments with
finite differences of moderate step can. Without process force the likelihood equals that of the filter.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from slapshot.arrays import Array
from slapshot.diagnosis.fit.fit import CONVERGED_SD, Fit
from slapshot.diagnosis.fit.linear import predicted_readings, residuals
from slapshot.diagnosis.fit.noise import Noise
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.segments import Segments

_POSITION_STEP, _VELOCITY_STEP = 1e-4, 1e-2
_PARAMETER_STEP = 0.03  # prior standard deviations
_DAMPINGS = 8
_LEAST = 1e-3  # minimum relative to the start, for positive values
MOST_ROUNDS = 20  # in which a fit must come near a level by the pace of the last two, or is given up


def simulate(
    simulator: Simulator, hypothesis: Hypothesis, theta: Array, segments: Segments, first: Array
) -> tuple[Array, Array]:
    """Simulate all segments from their first states.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: effects that are present.
        theta: values.
        segments: controls and times.
        first: (S, nq + nv + na).

    Returns:
        (S, L, nq + nv + na) states and (S, L, ny) observations of them.
    """
    S, L = segments.shape
    model = hypothesis.compiled(theta, segments.step)
    control = hypothesis.control(segments, theta)
    order = segments.order
    states = np.empty((S, L, first.shape[1]))
    seen = np.empty((S, L, segments.y.shape[2]))
    x = first
    if hypothesis.has_force:
        for t in range(L):
            states[:, t] = x
            x, seen[:, t], _ = simulator.advance(
                hypothesis, theta, model, x, control[:, t], segments.time[:, t], order
            )
    else:
        states, seen = simulator.trajectory(model, x, control)
    return states, seen


def shoot(
    simulator: Simulator,
    hypothesis: Hypothesis,
    theta: Array,
    segments: Segments,
    trajectory: Array,
    noise: Noise,
    rounds: int = 12,
    held: bool = False,
    level: float = -np.inf,
) -> Fit:
    """Fit values and first states by Levenberg and Marquardt's method.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: what to fit.
        theta: first values.
        segments: data.
        trajectory: (S, L, nx), whose first nodes are the prior means of initial states.
        noise: of the observations; its process force is ignored.
        rounds: at most.
        held: whether values are fixed and only initial states are fitted.
        level: log evidence that it has to reach, in these rounds or later ones: it is given up where it goes
            on too slowly for that, and its log evidence is then -inf.
    """
    tangent, S = simulator.tangent, segments.shape[0]
    p, dim = 0 if held else len(theta), tangent.dim
    theta, start = hypothesis.clipped(theta), trajectory[:, 0]
    first = start.copy()
    whiten, logdet = _whitening(segments, noise)
    spread = np.sqrt(noise.initial)

    def residual(values: Array, states: Array) -> tuple[Array, Array]:
        x, y = simulate(simulator, hypothesis, values, segments, states)
        e = residuals(hypothesis.rig, segments, predicted_readings(hypothesis, values, segments, y))
        return whiten(np.where(np.isfinite(segments.y), np.where(np.isfinite(e), e, 1e6), 0.0)), x

    def cost(e: Array, values: Array, states: Array) -> float:
        off = tangent.subtract(states, start) / spread
        prior = (values - hypothesis.start) / hypothesis.prior_sd
        return float(0.5 * (np.sum(e**2) + np.sum(off**2) + np.sum(prior**2)))

    e, x = residual(theta, first)
    now, damping = cost(e, theta, first), 1e-3
    converged, moved, evidence = False, np.inf, -np.inf
    positive = np.array([q.start > 0 and q.low >= 0 for q in hypothesis.parameters], bool)
    prior = hypothesis.prior_sd[:p] ** -2.0
    precision = np.diag(prior)
    gained: list[float] = []
    for number in range(rounds + 1):
        further = max(MOST_ROUNDS - number, 1) * max(gained[-2:], default=np.inf)
        if len(gained) > 1 and number < rounds and evidence + gained[-1] + further < level:
            evidence = -np.inf
            break
        Z = np.empty((S, e.shape[1], p))
        for k in range(p):
            step = _PARAMETER_STEP * hypothesis.prior_sd[k]
            if theta[k] + step > hypothesis.parameters[k].high:
                step = -step
            changed = theta.copy()
            changed[k] += step
            Z[..., k] = (e - residual(changed, first)[0]) / step
        J = np.empty((S, e.shape[1], dim))
        for i in range(dim):
            step = _POSITION_STEP if i < tangent.nv else _VELOCITY_STEP
            delta = np.zeros(dim)
            delta[i] = step
            J[..., i] = (e - residual(theta, tangent.add(first, delta))[0]) / step
        scaled = J * spread
        off = tangent.subtract(first, start) / spread
        own = np.matmul(scaled.transpose(0, 2, 1), scaled) + np.eye(dim)
        cross = np.matmul(scaled.transpose(0, 2, 1), Z)
        b_own = np.einsum("sni,sn->si", scaled, e) - off
        b = np.einsum("snk,sn->k", Z, e) - prior * (theta - hypothesis.start)[:p]
        information = np.einsum("snk,snl->kl", Z, Z) + np.diag(prior)
        solved = np.linalg.solve(own, np.concatenate([cross, b_own[..., None]], axis=2))
        precision = information - np.einsum("sik,sil->kl", cross, solved[..., :p])
        volume = np.linalg.slogdet(own)[1].sum() + np.linalg.slogdet(precision)[1]
        volume -= np.log(prior).sum() if p else 0.0
        evidence = noise.log_prior - now - 0.5 * logdet - 0.5 * volume
        if converged or number == rounds:
            break
        for _ in range(_DAMPINGS):
            damped = own + damping * np.einsum("sii->si", own)[:, :, None] * np.eye(dim)
            solved = np.linalg.solve(damped, np.concatenate([cross, b_own[..., None]], axis=2))
            target, delta = theta, solved[..., p] * spread
            if p:
                schur = information + damping * np.diag(np.diag(information))
                schur = schur - np.einsum("sik,sil->kl", cross, solved[..., :p])
                # Positive parameters, such as a compliance, are updated by factors.
                grade = np.where(positive, np.maximum(theta, _LEAST * hypothesis.start), 1.0)
                ahead = b - np.einsum("sik,si->k", cross, solved[..., p])
                step = np.linalg.solve(schur * np.outer(grade, grade), ahead * grade)
                factor = np.exp(np.where(positive, np.clip(step, -1.0, 1.0), 0.0))
                target = hypothesis.clipped(np.where(positive, grade * factor, theta + step))
                delta = (solved[..., p] - solved[..., :p] @ (target - theta)) * spread
            states = tangent.add(first, delta)
            tried, trace = residual(target, states)
            value = cost(tried, target, states)
            if value < now:
                sd = np.sqrt(np.diag(np.linalg.inv(precision))) if p else np.zeros(0)
                moved = float(np.max(np.abs(target - theta)[:p] / sd, initial=0.0))
                converged = now - value < CONVERGED_SD and moved < 1
                gained.append(now - value)
                theta, first, e, x, now = target, states, tried, trace, value
                damping = max(damping / 10, 1e-8)
                break
            damping *= 10
        else:
            # No step improves the cost: the limit of the finite differences is reached.
            converged = True
            break
    return Fit(hypothesis, theta, x, float(evidence), precision, converged, moved)


def fit_first_states(
    simulator: Simulator,
    hypothesis: Hypothesis,
    theta: Array,
    segments: Segments,
    trajectory: Array,
    noise: Noise,
    rounds: int,
) -> Array:
    """Trajectories (S, L, nx) from first states that fit best with given values, each segment by itself.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: effects that are present.
        theta: their values.
        segments: data.
        trajectory: (S, L, nx), whose first nodes are the prior means of first states.
        noise: of the observations.
        rounds: at most.
    """
    trajectory = trajectory.copy()
    for one in np.arange(len(trajectory))[:, None]:
        trajectory[one] = shoot(
            simulator, hypothesis, theta, segments.select(one), trajectory[one], noise.select(one), rounds,
            held=True,
        ).trajectory  # fmt: skip
    return trajectory


def _whitening(segments: Segments, noise: Noise) -> tuple[Callable[[Array], Array], float]:
    """A whitening function, (S, L, ny) to (S, L * ny), and the log determinant of the covariance."""
    S, L = segments.shape
    ny = segments.y.shape[2]
    lags = np.abs(np.arange(L)[:, None] - np.arange(L))
    roots = np.empty((S, ny, L, L))
    logdet, variance = 0.0, noise.variance
    for c in range(ny):
        correlation = np.exp(-lags * segments.interval / noise.correlation_s[c])
        coloured = noise.coloured[c] ** 2 * correlation
        level = np.ones(S) if noise.level is None else noise.level[:, c]
        there = np.isfinite(segments.y[..., c])
        white = variance[..., c]
        for s in range(S):
            gap = np.flatnonzero(~there[s])
            covariance = level[s] ** 2 * coloured + np.diag(white[s])
            covariance[gap, :] = 0
            covariance[:, gap] = 0
            covariance[gap, gap] = 1.0
            roots[s, c] = np.linalg.cholesky(covariance)
            logdet += 2 * np.log(np.diag(roots[s, c])).sum()

    def whiten(e: Array) -> Array:
        out = np.empty((S, ny, L))
        for c in range(ny):
            for s in range(S):
                out[s, c] = solve_triangular(roots[s, c], e[s, :, c], lower=True, check_finite=False)
        return out.reshape(S, -1)

    return whiten, logdet
