"""The Kalman filter of the method: one step, whole sequences, and their adjoint."""

from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


class FilterStep(NamedTuple):
    """Result of one filter step, and the quantities that its adjoint needs."""

    mean: Tensor  # mu_phi^{t+1|t+1}, (M, B, h)
    covariance: Tensor  # Sigma_phi^{t+1|t+1}, (M, B, h, h)
    gain: Tensor  # K, (M, B, h, k)
    shrinkage: Tensor  # I - K H, (M, B, h, h)
    residual: Tensor  # r = S^-1 (y - H mu), (M, B, k)


def kalman_step(mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor, drift: float) -> FilterStep:
    """One prediction step (random walk of phi) and one update with a whitened measurement.

    A measurement z ~ N(C phi, Sigma_z) with Sigma_z^-1 = L L' is the same as y ~ N(H phi, I) with
    y = L' z and H = L' C. Eqs. (pred_mean, pred_cov) with A = I, B = 0, Q = drift I, then eqs.
    (kalmangain, mu_update) are

        P  = Sigma_phi + drift I
        S  = H P H' + I,   K = P H' S^-1
        mu = mu + K (y - H mu)

    with K the paper's gain times L'^-1. Eq. (sigma_update) is taken in Joseph's form,

        Sigma_phi = (I - K H) P (I - K H)' + K K'

    which equals (I - K H) P for the exact gain, but is a sum of two positive semidefinite terms whose
    error is of second order in that of K. The short form is a difference, which becomes indefinite in
    float32 once a precise measurement has removed most of the variance.

    Args:
        mean: mu_phi before the step, (M, B, h).
        covariance: Sigma_phi before the step, (M, B, h, h).
        y: whitened measurement L' mu_z, (M, B, k).
        H: whitened measurement matrix L' C_z, (M, B, k, h).
        drift: epsilon of Q = epsilon I.
    """
    identity = torch.eye(mean.shape[-1], dtype=mean.dtype, device=mean.device)
    P = covariance + drift * identity
    PH = P @ H.mT
    S = H @ PH + torch.eye(y.shape[-1], dtype=mean.dtype, device=mean.device)
    # No eigenvalue of S is below 1, so only non-finite inputs could fail here, and they show in the
    # result: the _ex variant skips a check on every step.
    S_inverse = torch.cholesky_inverse(torch.linalg.cholesky_ex(S).L)
    gain = PH @ S_inverse
    innovation = y - times(H, mean)
    shrinkage = identity - gain @ H
    joseph = shrinkage @ P @ shrinkage.mT + gain @ gain.mT
    return FilterStep(
        mean=mean + times(gain, innovation),
        covariance=0.5 * (joseph + joseph.mT),
        gain=gain,
        shrinkage=shrinkage,
        residual=times(S_inverse, innovation),
    )


class PlainFilterMeans(torch.autograd.Function):
    """Means of phi after 0, 1, ..., N measurements: `kalman_step` in a loop, for any device.

    The gradient is a hand-written adjoint, made of matrix products only: faster than autograd of the loop.
    """

    @staticmethod
    def forward(ctx: Any, mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor, drift: float) -> Tensor:
        """Return (M, B, N + 1, h); arguments as in `kalman_step`, with y (M, B, N, k), H (M, B, N, k, h)."""
        ctx.save_for_backward(H)
        ctx.steps = []
        means = [mean]
        for y_i, H_i in zip(y.unbind(2), H.unbind(2), strict=True):
            step = kalman_step(mean, covariance, y_i, H_i, drift)
            mean, covariance = step.mean, step.covariance
            means.append(mean)
            ctx.steps.append(step)
        return torch.stack(means, dim=2)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Adjoint of the recursion, backwards in time.

        With l = dL/dmu and G = dL/dSigma_phi (symmetric) after a step, k = K' l, a = (I - K H)' l
        and Sigma, mu the step's results, differentiating eqs. (kalmangain) to (sigma_update) gives

            dL/dy = k
            dL/dH = r (Sigma l)' - k mu' - 2 K' G Sigma
            l    <- a + dL/dmu of the step before
            G    <- (I - K H)' G (I - K H) + sym(a (H' r)')
        """
        (H,) = ctx.saved_tensors
        per_step = gradients[0]
        l_mean = per_step[:, :, -1]
        l_cov = l_mean.new_zeros(*l_mean.shape, l_mean.shape[-1])
        l_y, l_H = H.new_empty(H.shape[:-1]), torch.empty_like(H)
        for i in reversed(range(len(ctx.steps))):
            step = ctx.steps[i]
            k, a = times(step.gain.mT, l_mean), times(step.shrinkage.mT, l_mean)
            l_y[:, :, i] = k
            l_H[:, :, i] = (
                _outer(step.residual, times(step.covariance, l_mean))
                - _outer(k, step.mean)
                - 2 * step.gain.mT @ l_cov @ step.covariance
            )
            from_gain = _outer(a, times(H[:, :, i].mT, step.residual))
            l_cov = step.shrinkage.mT @ l_cov @ step.shrinkage + 0.5 * (from_gain + from_gain.mT)
            l_mean = a + per_step[:, :, i]
        return l_mean, l_cov, l_y, l_H, None


def times(X: Tensor, v: Tensor) -> Tensor:
    """X v for X (..., r, c) and v (..., c)."""
    return (X @ v[..., None])[..., 0]


def _outer(u: Tensor, v: Tensor) -> Tensor:
    """U v' for u (..., r) and v (..., c)."""
    return u[..., :, None] * v[..., None, :]
