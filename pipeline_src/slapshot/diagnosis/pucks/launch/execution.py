"""How each hit was executed, from joint encoders: pace and smooth drift, told apart from missing physics.

What the encoders read beyond the simulated swing is, for hit i at time t and joint j,

    r_ij(t) = sum_k e_ijk (t / T)^k  -  p_i t dq_j/dt(t)  +  effects  +  white noise,   k = 1, 2, 3:

every joint drifts smoothly from the start, and the whole motion runs at another pace. The e and p of all
hits share one zero-mean Gaussian, whose covariance is estimated; an effect differs from them by doing the
same to all hits.
"""

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.recordings.format import joint_columns

READ_EVERY = 0.01  # s
_SAME = 1e-6  # relative difference of times that rounding makes
POWERS = (1, 2, 3)
ROUNDS = 6  # of expectation maximisation
LEAST_NOISE = 1e-6  # rad, finer than any encoder's step
LEAST_SD = 1e-5  # rad, of a coefficient
DIFFERENCES = 4  # in time, that tell noise from what moves smoothly
NORMAL_MEDIAN = 0.6745  # of the absolute value of a standard normal variable


@dataclass(frozen=True)
class Readings:
    """Encoders of n hits on one grid of times, and what the nominal swing would have them read.

    Attributes:
        times: (m,) s, on a grid that all hits cover.
        joints: (n, m, joints) rad, interpolated linearly from the readings next to them.
        nominal: (n, m, joints) rad, simulated.
        replayed: (n, c) coefficients of the execution that this simulation replayed.
    """

    times: Array
    joints: Array
    nominal: Array
    replayed: Array


def readings_of(
    joints: pd.DataFrame, hits: NDArray[np.int64], period: float, latest: float
) -> tuple[Array, Array]:
    """Times (m,) at which swings are known, up to `latest` (s), and what the encoders of the hits read then.

    They lie on the control period's grid, and are no closer than READ_EVERY, in multiples of which swings
    are simulated: arms move slowly, and readings at a kilohertz would fill the memory.
    """
    groups = dict(tuple(joints.groupby("hit")))
    columns = joint_columns(joints)
    first = groups[int(hits[0])]["t"].to_numpy()
    apart, least = float(np.median(np.diff(first))), round(READ_EVERY / period)
    every = max(1, round(apart / period)) if apart > (1 + _SAME) * READ_EVERY else max(1, least)
    end = min(latest, *(float(groups[int(h)]["t"].iloc[-1]) for h in hits))
    begin = max(float(groups[int(h)]["t"].iloc[0]) for h in hits)
    ticks = np.arange(
        -(-int(np.ceil(begin / period - _SAME)) // every) * every, int(end / period + _SAME) + 1, every
    )
    times = ticks * period
    stacked = np.stack(
        [
            np.stack([np.interp(times, groups[int(h)]["t"], groups[int(h)][c]) for c in columns], axis=1)
            for h in hits
        ]
    )
    return np.asarray(times, float), np.asarray(stacked, float)


class Execution:
    """Encoder residuals of n hits with the execution's own coefficients integrated out."""

    def __init__(
        self,
        times: Array,
        residual: Array,
        speeds: Array,
        replayed: Array | None = None,
        reference: "Execution | None" = None,
    ) -> None:
        """Of n hits.

        Args:
            times: (m,) s.
            residual: (n, m, joints) rad, read less simulated without effects.
            speeds: (n, m, joints) rad/s, simulated.
            replayed: (n, c) coefficients that the simulation replayed already; None for 0.
            reference: whose noise and scatter are taken for known, so that likelihoods can be compared.
        """
        self.times = times
        n, m, joints = residual.shape
        share = times / times[-1]
        drift = np.stack([share**k for k in POWERS], axis=1)  # (m, powers)
        basis = np.zeros((n, m, joints, 1 + joints * len(POWERS)))
        basis[..., 0] = -times[:, None] * speeds
        for j in range(joints):
            basis[:, :, j, 1 + j * len(POWERS) : 1 + (j + 1) * len(POWERS)] = drift
        self.basis = basis
        # As if it had replayed none: exact about what it did replay, where a motion's pace is not linear.
        self.residual = (
            residual if replayed is None else residual + np.einsum("nmjc,nc->nmj", basis, replayed)
        )
        flat, r = basis.reshape(n, m * joints, -1), self.residual.reshape(n, -1)
        self.sd: float = _noise_beside(flat, r, m) if reference is None else reference.sd
        self._gram = np.einsum("nab,nac->nbc", flat, flat) / self.sd**2
        self.covariance: Array = self._estimate(r) if reference is None else reference.covariance

    def _estimate(self, residual: Array) -> Array:
        """Covariance of the coefficients (c, c), by expectation maximisation."""
        n = len(residual)
        flat = self.basis.reshape(n, -1, self.basis.shape[-1])
        load = np.einsum("nab,na->nb", flat, residual) / self.sd**2
        covariance = np.diag(np.full(flat.shape[-1], 1e-4))
        for _ in range(ROUNDS):
            spread = np.linalg.inv(self._gram + np.linalg.inv(covariance))
            mean = np.einsum("nab,nb->na", spread, load)
            covariance = (np.einsum("na,nb->ab", mean, mean) + spread.sum(0)) / n
            covariance += LEAST_SD**2 * np.eye(len(covariance))
        return covariance

    def coefficients(self, residual: Array) -> tuple[Array, Array]:
        """Posterior mean (n, c) and covariance (n, c, c) of the coefficients for residuals (n, m, joints)."""
        n = len(residual)
        flat = self.basis.reshape(n, -1, self.basis.shape[-1])
        spread = np.linalg.inv(self._gram + np.linalg.inv(self.covariance))
        load = np.einsum("nab,na->nb", flat, residual.reshape(n, -1)) / self.sd**2
        return np.einsum("nab,nb->na", spread, load), spread

    def whiten(self, residual: Array) -> Array:
        """(n, rows) whose scalar products are those of residuals (n, m, joints) in the marginal's metric.

        With S = sd^2 I + B C B', x' S^-1 y = (x'y - x'B (B'B + sd^2 C^-1)^-1 B'y) / sd^2: the part within
        the basis is shrunk, the rest is divided by sd.
        """
        r = residual.reshape(len(residual), -1, 1)
        within, shrunk = self._factors
        inside = within.transpose(0, 2, 1) @ r
        return np.concatenate([shrunk @ inside, (r - within @ inside) / self.sd], axis=1)[..., 0]

    @cached_property
    def _factors(self) -> tuple[Array, Array]:
        """Orthonormal basis (n, rows, c), and what whitens (n, c, c) the part within it."""
        q, upper = np.linalg.qr(self.basis.reshape(len(self.basis), -1, self.basis.shape[-1]))
        spread = upper @ self.covariance @ upper.transpose(0, 2, 1) + self.sd**2 * np.eye(upper.shape[-1])
        return q, np.linalg.inv(np.linalg.cholesky(spread))

    def displacement(self, coefficients: Array, moment: Array, speeds: Array) -> tuple[Array, Array]:
        """Joint offsets (n, joints) in rad and their rates at moments (n,), of coefficients (n, c).

        Args:
            coefficients: pace first, then each joint's drift.
            moment: (n,) s.
            speeds: (n, joints) rad/s of the swing at that moment, whose change is left out.
        """
        n, joints = speeds.shape
        end = self.times[-1]
        drift = coefficients[:, 1:].reshape(n, joints, len(POWERS))
        share = (moment / end)[:, None]
        powers = np.concatenate([share**k for k in POWERS], axis=1)
        rates = np.concatenate([k * share ** (k - 1) / end for k in POWERS], axis=1)
        pace = coefficients[:, :1]
        offset = np.einsum("njk,nk->nj", drift, powers) - pace * moment[:, None] * speeds
        return offset, np.einsum("njk,nk->nj", drift, rates) - pace * speeds


def _noise_beside(basis: Array, residual: Array, ticks: int) -> float:
    """Sd of white noise in residuals (n, ticks * joints) that have anything smooth beside it.

    From differences of a high order, which what a servo does wrong hardly enters; where there are too few
    ticks for that, from what the basis (n, ticks * joints, c) leaves, which counts it as noise.
    """
    if ticks > 2 * DIFFERENCES:
        differences = np.diff(residual.reshape(len(residual), ticks, -1), n=DIFFERENCES, axis=1)
        gain = np.sqrt(comb(2 * DIFFERENCES, DIFFERENCES))
        return max(float(np.median(np.abs(differences)) / NORMAL_MEDIAN / gain), LEAST_NOISE)
    fitted = [f @ np.linalg.lstsq(f, y, rcond=None)[0] for f, y in zip(basis, residual, strict=True)]
    left = (residual - np.stack(fitted)) ** 2
    return max(float(np.sqrt(np.median(left.sum(1) / (basis.shape[1] - basis.shape[2])))), LEAST_NOISE)


def pace_matrix(execution: Execution, moment: Array, speeds: Array) -> tuple[Array, Array]:
    """`displacement` as matrices (n, joints, c): of the offsets and of their rates."""
    size = execution.basis.shape[-1]
    n, joints = speeds.shape
    offset, rate = np.empty((2, n, joints, size))
    for c in range(size):
        unit = np.zeros((n, size))
        unit[:, c] = 1.0
        offset[..., c], rate[..., c] = execution.displacement(unit, moment, speeds)
    return offset, rate


def replay(positions: Array, period: float, end: float, coefficients: Array) -> Array:
    """Commands (n, ticks, joints) in rad as they were executed: at another pace, drifting off.

    Args:
        positions: as commanded, one every `period` s.
        period: s.
        end: s, time unit of the drift.
        coefficients: (n, c), pace first, then each joint's drift.
    """
    n, ticks, joints = positions.shape
    times = np.arange(ticks) * period
    drift = coefficients[:, 1:].reshape(n, joints, len(POWERS))
    # Past the end of what was read nothing is known of the drift.
    share = np.minimum(times / end, 1.0)
    powers = np.stack([share**k for k in POWERS])
    executed = np.einsum("njk,kt->ntj", drift, powers)
    for i in range(n):
        # A slower pace is a positive coefficient's opposite: the residual was -p t dq/dt.
        at = np.clip((1 - coefficients[i, 0]) * times / period, 0, ticks - 1 - 1e-9)
        low = at.astype(int)
        part = (at - low)[:, None]
        executed[i] += (1 - part) * positions[i, low] + part * positions[i, low + 1]
    return executed
