"""The filter and its smoother against the dense joint Gaussian of everything, by plain linear algebra."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from slapshot.diagnosis.fit.filter import Covariances, Linear, innovations, leave_one_out, smooth

S, L, N, NV, NY, P = 3, 7, 4, 2, 3, 2  # segments, nodes, states, forces, channels, columns


def random_system(seed: int, *, missing: bool = True, held: bool = False) -> Linear:
    rng = np.random.default_rng(seed)
    r = rng.normal(size=(S, L, NY))
    if missing:
        r[rng.random(r.shape) < 0.25] = np.nan
        r[1, 3], r[2, 0], r[0, -1] = np.nan, np.nan, np.nan  # whole nodes, the first and the last among them
    return Linear(
        A=np.eye(N) + 0.3 * rng.normal(size=(S, L, N, N)),
        B=rng.normal(size=(S, L, N, NV)),
        d=rng.normal(size=(S, L, N)),
        C=rng.normal(size=(S, L, NY, N)),
        r=r,
        W=rng.normal(size=(S, L, N, P)),
        psi=rng.normal(size=(S, L, NY, P)),
        process=rng.normal(size=(S, L, N, NV)) if held else None,
    )


def random_noise(seed: int, *, coloured: bool = True, inflated: bool = False) -> Covariances:
    rng = np.random.default_rng(seed)
    return Covariances(
        initial=rng.uniform(0.5, 4, N),
        force=rng.uniform(0.1, 1, NV),
        white=rng.uniform(0.1, 2, (S, L, NY)),
        coloured=np.array([0.8, 0.0, 1.7]) if coloured else np.zeros(NY),
        decay=np.array([0.9, 0.5, 0.3]),
        inflation=rng.uniform(1, 50, (S, L)) if inflated else None,
        level=rng.uniform(0.5, 2, (S, NY)) if coloured else None,
    )


@dataclass(frozen=True)
class Dense:
    """Moments of one segment's data and unknowns; y is (L, NY) in one row, without what is missing.

    Attributes:
        mean, columns, covariance: of y, its change by θ, and its covariance.
        delta, delta_covariance, delta_columns: mean of all δ, (L, N), their covariance with y, change by θ.
        force_covariance, coloured_covariance: of all forces, (L, NV), and coloured noise, (L, NY), with y.
        seen: what is not missing.
    """

    mean: np.ndarray
    columns: np.ndarray
    covariance: np.ndarray
    delta: np.ndarray
    delta_covariance: np.ndarray
    force_covariance: np.ndarray
    coloured_covariance: np.ndarray
    seen: np.ndarray


def dense(system: Linear, noise: Covariances, k: int) -> Dense:
    """Every random number of a segment is one entry of one long vector, with its own variance.

    They are δ_0, the forces, the first coloured noise and what comes to it, and the white noise; the
    recursion is run once for each with all others 0.
    """
    forces, drives = L * NV, L * NY
    inflation = np.ones(L) if noise.inflation is None else noise.inflation[k]
    coloured = noise.coloured * (1.0 if noise.level is None else noise.level[k] ** 2)
    variance = np.concatenate([
        noise.initial, np.outer(inflation, noise.force).ravel(), coloured,
        np.tile(coloured * (1 - noise.decay**2), L), noise.white[k].ravel(),
    ])  # fmt: skip

    def run(z: np.ndarray, theta: np.ndarray, known: float) -> tuple[np.ndarray, ...]:
        delta, rest = z[:N], z[N:]
        force, rest = rest[:forces].reshape(L, NV), rest[forces:]
        coloured, rest = rest[:NY], rest[NY:]
        drive, white = rest[:drives].reshape(L, NY), rest[drives:].reshape(L, NY)
        y, trajectory, colours = [], [], []
        for t in range(L):
            trajectory.append(delta)
            colours.append(coloured)
            y.append(system.C[k, t] @ delta + system.psi[k, t] @ theta + coloured + white[t])
            delta = system.A[k, t] @ delta + known * system.d[k, t] + system.W[k, t] @ theta
            delta = delta + (system.B if system.process is None else system.process)[k, t] @ force[t]
            coloured = noise.decay * coloured + drive[t]
        return np.ravel(y), np.ravel(trajectory), np.ravel(colours)

    none = np.zeros(len(variance))
    mean, delta, _ = run(none, np.zeros(P), 1.0)
    columns = np.stack([run(none, unit, 0.0)[0] for unit in np.eye(P)], axis=1)
    maps = [run(unit, np.zeros(P), 0.0) for unit in np.eye(len(variance))]
    to_y, to_delta, to_coloured = (np.stack(part, axis=1) for part in zip(*maps, strict=True))
    seen = np.isfinite(system.r[k].ravel())
    to_force = np.eye(len(variance))[N : N + forces]
    weighted = variance[:, None] * to_y[seen].T
    return Dense(
        mean[seen],
        columns[seen],
        to_y[seen] @ weighted,
        delta,
        to_delta @ weighted,
        to_force @ weighted,
        to_coloured @ weighted,
        seen,
    )


@pytest.fixture(
    params=[(True, True, False), (True, False, True), (False, False, False)],
    ids=["coloured+gaps", "gaps+inflated+held", "plain"],
)
def case(request) -> tuple[Linear, Covariances]:
    missing, coloured, inflated = request.param
    return random_system(1, missing=missing, held=inflated), random_noise(
        2, coloured=coloured, inflated=inflated
    )


def test_innovations_are_those_of_the_dense_gaussian(case):
    system, noise = case
    found = innovations(system, noise)
    for k in range(S):
        of = dense(system, noise, k)
        # The Cholesky factor whitens every number given those before it, as a filter does.
        factor = np.linalg.cholesky(of.covariance)
        y = system.r[k].ravel()[of.seen]
        np.testing.assert_allclose(
            found.e[k].ravel()[of.seen], np.linalg.solve(factor, y - of.mean), atol=1e-9
        )
        np.testing.assert_allclose(
            found.Z[k].reshape(-1, P)[of.seen], np.linalg.solve(factor, of.columns), atol=1e-9
        )
        np.testing.assert_allclose(found.logdet[k], np.linalg.slogdet(of.covariance)[1], atol=1e-9)
        assert np.all(found.e[k].ravel()[~of.seen] == 0)
        assert np.all(found.Z[k].reshape(-1, P)[~of.seen] == 0)
    assert found.count == np.isfinite(system.r).sum()


def test_smoothed_states_and_forces_are_the_conditional_means(case):
    system, noise = case
    delta, force, coloured = smooth(system, noise)
    for k in range(S):
        of = dense(system, noise, k)
        gain = np.linalg.solve(of.covariance, system.r[k].ravel()[of.seen] - of.mean)
        np.testing.assert_allclose(delta[k].ravel(), of.delta + of.delta_covariance @ gain, atol=1e-8)
        np.testing.assert_allclose(force[k].ravel(), of.force_covariance @ gain, atol=1e-8)
        np.testing.assert_allclose(coloured[k].ravel(), of.coloured_covariance @ gain, atol=1e-8)


def test_what_is_left_out_is_predicted_from_all_others(case):
    system, noise = case
    residual, variance = leave_one_out(system, noise)
    for k in range(S):
        of = dense(system, noise, k)
        precision = np.linalg.inv(of.covariance)
        expected = precision @ (system.r[k].ravel()[of.seen] - of.mean) / np.diag(precision)
        np.testing.assert_allclose(residual[k].ravel()[of.seen], expected, atol=1e-8)
        np.testing.assert_allclose(variance[k].ravel()[of.seen], 1 / np.diag(precision), rtol=1e-7)
        np.testing.assert_array_equal(residual[k].ravel()[~of.seen], 0)


def test_innovations_are_linear_in_the_columns(case):
    system, noise = case
    theta = np.array([0.7, -1.9])
    there, base = innovations(system.moved(theta), noise), innovations(system, noise)
    np.testing.assert_allclose(there.e, base.e - base.Z @ theta, atol=1e-9)
    np.testing.assert_allclose(there.logdet, base.logdet, atol=1e-12)


def test_segments_know_nothing_of_each_other(case):
    system, noise = case
    whole, (delta, force, _) = innovations(system, noise), smooth(system, noise)
    for k in range(S):
        alone = np.array([k])
        inflation = None if noise.inflation is None else noise.inflation[alone]
        level = None if noise.level is None else noise.level[alone]
        own = replace(noise, white=noise.white[alone], inflation=inflation, level=level)
        part = innovations(system.select(alone), own)
        # The same operations in the same order; the compiler may fuse them in another way.
        np.testing.assert_allclose(part.e[0], whole.e[k], atol=1e-12)
        np.testing.assert_allclose(part.Z[0], whole.Z[k], atol=1e-12)
        np.testing.assert_allclose(part.logdet[0], whole.logdet[k], atol=1e-12)
        one = smooth(system.select(alone), own)
        np.testing.assert_allclose(one[0][0], delta[k], atol=1e-12)
        np.testing.assert_allclose(one[1][0], force[k], atol=1e-12)


def test_no_columns_and_no_data():
    system, noise = random_system(3).without_columns(), random_noise(4)
    assert innovations(system, noise).Z.shape == (S, L, NY, 0)
    blind = replace(system, r=np.full_like(system.r, np.nan))
    found = innovations(blind, noise)
    assert found.count == 0
    assert np.all(found.e == 0)
    assert np.all(found.logdet == 0)
    delta, force, _ = smooth(blind, noise)
    expected = np.zeros((S, L, N))
    for t in range(L - 1):
        expected[:, t + 1] = np.einsum("sij,sj->si", blind.A[:, t], expected[:, t]) + blind.d[:, t]
    np.testing.assert_allclose(delta, expected, atol=1e-10)
    assert np.all(force == 0)


def test_without_process_force_the_smoothed_path_obeys_the_model():
    system, noise = random_system(5), replace(random_noise(6), force=np.zeros(NV))
    delta, force, _ = smooth(system, noise)
    following = np.einsum("stij,stj->sti", system.A, delta) + system.d
    np.testing.assert_allclose(delta[:, 1:], following[:, :-1], atol=1e-8)
    assert np.all(force == 0)


def test_wide_first_states_and_small_noise_keep_their_digits():
    """An encoder of 10 µrad and a first position known to 1 rad: variances 10^10 apart."""
    steps, interval = 60, 0.01
    rng = np.random.default_rng(7)
    A = np.array([[1.0, interval], [0.0, 1.0]])
    C, R, initial = np.array([[1.0, 0.0]]), 1e-10, np.array([1.0, 100.0])
    line = 0.3 + 2 * interval * np.arange(steps)
    r = (line + 1e-5 * rng.standard_normal(steps))[None, :, None]
    shape = (1, steps)
    system = Linear(
        np.broadcast_to(A, (*shape, 2, 2)), np.zeros((*shape, 2, 1)), np.zeros((*shape, 2)),
        np.broadcast_to(C, (*shape, 1, 2)), r, np.zeros((*shape, 2, 0)), np.zeros((*shape, 1, 0)),
    )  # fmt: skip
    noise = Covariances(initial, np.zeros(1), np.full((*shape, 1), R), np.zeros(1), np.full(1, 0.5))
    found, (delta, *_) = innovations(system, noise), smooth(system, noise)
    # A straight line through all samples, by least squares with the prior as two further rows.
    design = np.column_stack([np.ones(steps), interval * np.arange(steps)])
    rows = np.vstack([design / np.sqrt(R), np.diag(initial**-0.5)])
    told = np.concatenate([r[0, :, 0] / np.sqrt(R), np.zeros(2)])
    values, squares, *_ = np.linalg.lstsq(rows, told, rcond=None)
    # The covariance is known to 1e-16 · 10^10 at first, and better from the second sample on.
    np.testing.assert_allclose(delta[0, :, 0], design @ values, atol=1e-3 * 1e-5)
    np.testing.assert_allclose(np.sum(found.e**2), squares[0], rtol=1e-3)
    covariance = design @ np.diag(initial) @ design.T + R * np.eye(steps)
    np.testing.assert_allclose(found.logdet[0], np.linalg.slogdet(covariance)[1], atol=1e-2)
