"""A hit's own unknowns integrated out: what is left is a quadratic in the shared parameters.

With whitened residuals z = y - f, Jacobians H (by the hit's latents u) and J (by shared parameters t), and
a Gaussian prior of the latents with mean m and square root information R (R'R = P^-1), to second order

    -2 log p(y | t + d) = min over e of |z - H e - J d|^2 + |R (m + dm/dt d - u - e)|^2 + constants,

a least-squares problem in e. Projecting [z; R (m - u)] and [J; -R dm/dt] off the columns of [H; R] leaves
|z~ - J~ d|^2, so that correlated errors along a track count once.
"""

from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array


@dataclass(frozen=True)
class Marginal:
    """n hits, p shared parameters.

    Attributes:
        information: (n, p, p) J~'J~ of each hit.
        scores: (n, p) J~'z~.
        squares: (n,) |z~|^2.
        log_volume: (n,) log det [H; R]'[H; R], less that of the prior's information where that is kept apart.
        step: (n, u) change of the latents that is best at d = 0.
        covariance: (n, u, u) of the latents given the shared parameters.
        gain: (n, u, p) by which the best latents change with d.
        told: launches (n, 5) as slides alone tell them, and their covariance (n, 5, 5); None where no slide
            was seen.
    """

    information: Array
    scores: Array
    squares: Array
    log_volume: Array
    step: Array
    covariance: Array
    gain: Array
    told: tuple[Array, Array] | None = None


def marginalise(
    z: Array, by_latent: Array, by_shared: Array, offset: Array, root: Array, prior_by_shared: Array
) -> Marginal:
    """Integrate the latents out.

    Args:
        z: (n, m) whitened residuals.
        by_latent: (n, m, u) whitened derivatives of the prediction.
        by_shared: (n, m, p) likewise.
        offset: (n, u) prior mean minus latents.
        root: (u, u) square root of the prior's information; rows of 0 for a flat prior.
        prior_by_shared: (n, u, p) derivatives of the prior mean.
    """
    n, _, u = by_latent.shape
    root = np.broadcast_to(root, (n, u, u))
    h = np.concatenate([by_latent, root], axis=1)
    q, r = np.linalg.qr(h)
    y = np.concatenate([z, np.einsum("nij,nj->ni", root, offset)], axis=1)
    j = np.concatenate([by_shared, -root @ prior_by_shared], axis=1)
    qy = np.einsum("nmu,nm->nu", q, y)
    qj = q.transpose(0, 2, 1) @ j
    rest_y = y - np.einsum("nmu,nu->nm", q, qy)
    rest_j = j - q @ qj
    inverse = np.linalg.inv(r)
    return Marginal(
        information=rest_j.transpose(0, 2, 1) @ rest_j,
        scores=np.einsum("nmp,nm->np", rest_j, rest_y),
        squares=(rest_y**2).sum(1),
        log_volume=2 * np.log(np.abs(np.diagonal(r, axis1=1, axis2=2))).sum(1),
        step=np.einsum("nij,nj->ni", inverse, qy),
        covariance=inverse @ inverse.transpose(0, 2, 1),
        gain=-inverse @ qj,
    )
