"""A Kalman filter over many segments at once, in innovations form, and its smoother.

In every segment the change δ_t from the trajectory obeys

    δ_{t+1} = A_t δ_t + d_t + W_t θ + B_t f_t,      f_t ~ N(0, diag(q))
    r_t     = C_t δ_t + Ψ_t θ + n_t + T_t ε_t + v_t,  v_t ~ N(0, diag(R_t)),  ε_t ~ N(0, I)
    n_{t+1} = diag(φ) n_t + noise,                  n_t ~ N(0, diag(ω²))

with coloured observation noise n (Ornstein-Uhlenbeck) and noise ε that channels of one clock share as further
states. Innovations are linear in θ, so
that one pass gives whitened innovations e and whitened columns Z with e - Z θ ~ N(0, I), and the log
determinant of their covariance. Observations enter one at a time (R is diagonal): nothing is inverted.

The smoother is that of Bryson and Frazier (1963; Bierman 1973), which needs no inverse of a covariance
either: without process noise that would be singular.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slapshot.arrays import Array


@dataclass(frozen=True)
class Linear:
    """A linear system about a trajectory: S segments of L nodes, n = 2 nv + na, p columns.

    Attributes:
        A: (S, L, n, n) transition.
        B: (S, L, n, nv) effect of a force held over the interval.
        d: (S, L, n) defect: the model's next state less the trajectory's next node.
        C: (S, L, ny, n) observation.
        r: (S, L, ny) recorded less observed on the trajectory; NaN where nothing was recorded.
        W: (S, L, n, p) change of the transition by each parameter.
        psi: (S, L, ny, p) change of the observation by each parameter.
        spread: (S, L, n, n) effect of a change in every step on the end of an interval.
        halved: (S, L, n) change of the transition with steps of half the length; None if not computed.
        process: (S, L, n, nv) effect of the process force, which a joint at rest feels in spite of its
            friction, and which acts on the inertia of the nominal model; None for B.
        at_rest: (S, L, nv) variance of a further process force where friction holds joints; None for 0.
    """

    A: Array
    B: Array
    d: Array
    C: Array
    r: Array
    W: Array
    psi: Array
    spread: Array | None = None
    halved: Array | None = None
    process: Array | None = None
    at_rest: Array | None = None

    @property
    def process_force(self) -> Array:
        """(S, L, n, nv) effect of the process force."""
        return self.B if self.process is None else self.process

    def select(self, segments: NDArray[np.intp] | NDArray[np.bool_]) -> "Linear":
        """The same of some segments."""
        there = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Linear(**{name: array[segments] for name, array in there.items() if array is not None})

    def moved(self, theta: Array) -> "Linear":
        """The same with the parameters changed by theta, to first order."""
        return replace(self, d=self.d + self.W @ theta, r=self.r - self.psi @ theta)

    def without_columns(self) -> "Linear":
        """The same with p = 0."""
        return self.with_columns(self.W[..., :0], self.psi[..., :0])

    def with_columns(self, W: Array, psi: Array) -> "Linear":
        """The same with other columns."""
        return replace(self, W=W, psi=psi)


@dataclass(frozen=True)
class Covariances:
    """Covariances of the filter.

    Attributes:
        initial: (n,) variances of a segment's first δ: wide.
        force: (nv,) variances of the process force, held over one interval.
        white: (S, L, ny) variances R of white observation noise.
        coloured: (ny,) variances ω² of coloured observation noise; 0 for none.
        decay: (ny,) φ, its correlation over one interval.
        shared: (S, L, ny, k) T, of noise of unit size that channels share; None for none.
        inflation: (S, L) factor on the variances of the process force; None for 1.
        level: (S, ny) factor on the coloured noise of a segment; None for 1.
    """

    initial: Array
    force: Array
    white: Array
    coloured: Array
    decay: Array
    shared: Array | None = None
    inflation: Array | None = None
    level: Array | None = None


@dataclass(frozen=True)
class Innovations:
    """Whitened innovations.

    Attributes:
        e: (S, L, ny); 0 where nothing was recorded.
        Z: (S, L, ny, p) columns.
        logdet: (S,) log determinant of each segment's innovation covariance.
        count: number of observations.
        variance: (S, L, ny) of each observation given those before it, noise included; where nothing was
            recorded too.
    """

    e: Array
    Z: Array
    logdet: Array
    count: int
    variance: Array


def innovations(system: Linear, noise: Covariances) -> Innovations:
    """Whitened innovations of all segments."""
    e, z, logdet, variance, *_ = _forward(False, *_arguments(system, noise))
    return Innovations(e, z, logdet, int(np.isfinite(system.r).sum()), variance)


def smooth(system: Linear, noise: Covariances) -> tuple[Array, Array, Array]:
    """Smoothed changes from the trajectory, process forces and coloured observation noise.

    Returns:
        (S, L, n), (S, L, nv) and (S, L, ny); the force of the last node, which leads nowhere, is 0.
    """
    arguments = _arguments(system, noise)
    *_, x, P, K, s, innovation = _forward(True, *arguments)
    n = system.d.shape[-1]
    delta, adjoint = _backward(arguments[0], arguments[3], x, P, K, s, innovation)
    force = np.zeros((*system.d.shape[:2], system.B.shape[-1]))
    adjoint_force = np.einsum("stij,sti->stj", system.process_force[:, :-1], adjoint[:, 1:, :n])
    force[:, :-1] = -_force_variance(system, noise)[:, :-1] * adjoint_force
    coloured = np.zeros(system.r.shape)
    channels = np.flatnonzero(noise.coloured > 0)
    coloured[..., channels] = delta[..., n : n + len(channels)]
    if noise.level is not None:
        coloured *= noise.level[:, None]
    return delta[..., :n], force, coloured


def leave_one_out(system: Linear, noise: Covariances) -> tuple[Array, Array]:
    """Leave-one-out residual of each observation given all others of its segment, and its variance.

    By the smoother's recursions (de Jong 1989, Biometrika 76(4)).

    Returns:
        (S, L, ny) and (S, L, ny); 0 and infinite where nothing was recorded.
    """
    arguments = _arguments(system, noise)
    *_, K, s, innovation = _forward(True, *arguments)
    return _left_out(arguments[0], arguments[3], K, s, innovation)


def _force_variance(system: Linear, noise: Covariances) -> Array:
    """(S, L, nv) of all process force."""
    inflation = np.ones(system.B.shape[:2]) if noise.inflation is None else noise.inflation
    variance = noise.force * inflation[..., None]
    return variance if system.at_rest is None else variance + system.at_rest


def _arguments(system: Linear, noise: Covariances) -> tuple[Array, ...]:
    """Arrays of the extended state (δ, n, ε); of n, coloured channels alone add states."""
    segments, nodes, n = system.d.shape
    channels = np.flatnonzero(noise.coloured > 0)
    shared = noise.shared if noise.shared is not None else np.zeros((segments, nodes, system.r.shape[2], 0))
    m, k, nv = len(channels), shared.shape[-1], system.B.shape[-1]
    A = np.zeros((segments, nodes, n + m + k, n + m + k))
    A[..., :n, :n] = system.A
    A[..., range(n, n + m), range(n, n + m)] = noise.decay[channels]
    B = np.zeros((segments, nodes, n + m + k, nv + m + k))
    B[..., :n, :nv] = system.process_force * np.sqrt(_force_variance(system, noise))[..., None, :]
    B[..., range(n, n + m + k), range(nv, nv + m + k)] = 1
    own = (noise.coloured * (1 - noise.decay**2))[channels]
    q = np.concatenate([np.ones(nv), own, np.ones(k)])
    C = np.zeros((segments, nodes, system.C.shape[2], n + m + k))
    C[..., :n] = system.C
    C[..., channels, range(n, n + m)] = 1.0 if noise.level is None else noise.level[:, None, channels]
    C[..., n + m :] = shared
    d = np.zeros((segments, nodes, n + m + k))
    d[..., :n] = system.d
    W = np.ascontiguousarray(system.W)
    initial = np.concatenate([noise.initial, noise.coloured[channels], np.ones(k)])
    psi = np.ascontiguousarray(system.psi)
    return A, B, d, C, np.ascontiguousarray(system.r), W, psi, noise.white, initial, q


@njit(cache=True, fastmath={"contract", "reassoc", "arcp", "nsz"})
def _forward(keep, A, B, d, C, r, W, psi, R, initial, q):  # type: ignore[no-untyped-def]
    S, L, n = d.shape
    ny, p, nf = r.shape[2], W.shape[3], B.shape[3]
    moved = W.shape[2]  # noise states come last and have no columns
    e, z, logdet = np.zeros((S, L, ny)), np.zeros((S, L, ny, p)), np.zeros(S)
    variance = np.zeros((S, L, ny))
    kept = L if keep else 0
    x_at, P_at = np.zeros((S, kept, n)), np.zeros((S, kept, n, n))
    K_at, s_at, i_at = np.zeros((S, kept, ny, n)), np.zeros((S, kept, ny)), np.zeros((S, kept, ny))
    for k in range(S):
        x, X, Y, P = np.zeros(n), np.zeros((n, p)), np.zeros((moved, p)), np.diag(initial)
        g, PA = np.zeros(n), np.zeros((n, n))
        for t in range(L):
            if keep:
                x_at[k, t], P_at[k, t] = x, P
            for c in range(ny):
                row = C[k, t, c]
                s, innovation = R[k, t, c], r[k, t, c]
                for i in range(n):
                    g[i] = 0.0
                    for j in range(n):
                        g[i] += P[i, j] * row[j]
                    innovation -= row[i] * x[i]
                for i in range(n):
                    s += row[i] * g[i]
                variance[k, t, c] = s
                if np.isnan(r[k, t, c]):
                    if keep:
                        s_at[k, t, c] = np.inf
                    continue
                root = np.sqrt(s)
                e[k, t, c] = innovation / root
                logdet[k] += np.log(s)
                # Columns are contiguous in the inner loops, which dominate the run time.
                at = z[k, t, c]
                at[:] = psi[k, t, c]
                for i in range(n):
                    if row[i] != 0.0:
                        for a in range(p):
                            at[a] += row[i] * X[i, a]
                for i in range(n):
                    gain = g[i] / s
                    if gain != 0.0:
                        for a in range(p):
                            X[i, a] -= gain * at[a]
                for a in range(p):
                    at[a] /= root
                for i in range(n):
                    x[i] += g[i] * (innovation / s)
                    for j in range(n):
                        P[i, j] -= g[i] * g[j] / s
                if keep:
                    s_at[k, t, c], i_at[k, t, c] = s, innovation
                    K_at[k, t, c] = g / s
            if t == L - 1:
                break
            At, Bt = A[k, t], B[k, t]
            x = At @ x + d[k, t]
            if p > 0:
                # Noise states do not mix with others.
                for i in range(moved):
                    to = Y[i]
                    to[:] = W[k, t, i]
                    for j in range(moved):
                        along = At[i, j]
                        if along != 0.0:
                            for a in range(p):
                                to[a] += along * X[j, a]
                for i in range(moved, n):
                    for a in range(p):
                        X[i, a] *= At[i, i]
                X[:moved] = Y
            PA = P @ At.T
            P = At @ PA
            for i in range(n):
                for j in range(i + 1):
                    value = 0.5 * (P[i, j] + P[j, i])
                    for f in range(nf):
                        value += Bt[i, f] * q[f] * Bt[j, f]
                    P[i, j] = value
                    P[j, i] = value
    return e, z, logdet, variance, x_at, P_at, K_at, s_at, i_at


@njit(cache=True)
def _backward(A, C, x_at, P_at, K_at, s_at, i_at):  # type: ignore[no-untyped-def]
    S, L, n = x_at.shape
    ny = s_at.shape[2]
    smoothed, adjoint = np.zeros((S, L, n)), np.zeros((S, L, n))
    for k in range(S):
        a = np.zeros(n)
        for t in range(L - 1, -1, -1):
            if t < L - 1:
                a = A[k, t].T @ a
            for c in range(ny - 1, -1, -1):
                if np.isinf(s_at[k, t, c]):
                    continue
                along = i_at[k, t, c] / s_at[k, t, c]
                for i in range(n):
                    along += K_at[k, t, c, i] * a[i]
                for i in range(n):
                    a[i] -= C[k, t, c, i] * along
            adjoint[k, t] = a
            smoothed[k, t] = x_at[k, t] - P_at[k, t] @ a
    return smoothed, adjoint


@njit(cache=True)
def _left_out(A, C, K_at, s_at, i_at):  # type: ignore[no-untyped-def]
    S, L, n = A.shape[:3]
    ny = s_at.shape[2]
    residual, variance = np.zeros((S, L, ny)), np.full((S, L, ny), np.inf)
    for k in range(S):
        a, N = np.zeros(n), np.zeros((n, n))
        for t in range(L - 1, -1, -1):
            if t < L - 1:
                a = A[k, t].T @ a
                N = A[k, t].T @ N @ A[k, t]
            for c in range(ny - 1, -1, -1):
                s = s_at[k, t, c]
                if np.isinf(s):
                    continue
                gain, row = K_at[k, t, c], C[k, t, c]
                w = N @ gain
                along, precision = i_at[k, t, c] / s, 1 / s
                for i in range(n):
                    along += gain[i] * a[i]
                    precision += gain[i] * w[i]
                variance[k, t, c] = 1 / precision
                residual[k, t, c] = along / precision
                for i in range(n):
                    a[i] -= row[i] * along
                    for j in range(n):
                        N[i, j] += precision * row[i] * row[j] - row[i] * w[j] - w[i] * row[j]
    return residual, variance
