"""Variance of predicted rest points, and its expected reduction by a hit that was not made yet."""

import torch
from torch import Tensor

from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.kalman_filter import kalman_step


@torch.no_grad()
def outcome_jacobian(method: Kalman, belief: KalmanBelief, state: Tensor, action: Tensor) -> Tensor:
    """Jacobian d f^p(s, a, phi) / d phi at the belief's mean, (M, B, Q, do, h), for queries (M, B, Q, d).

    By central differences: phi has few dimensions, and each takes two passes with all queries at once.
    """
    step = 1e-2  # in units of the prior's standard deviation, about 1: far above float32's rounding
    columns = []
    for i in range(belief.mean.shape[-1]):
        shift = torch.zeros(belief.mean.shape[-1])
        shift[i] = step
        ahead, behind = (
            method.outcome((belief.mean + sign * shift)[:, :, None], state, action) for sign in (1, -1)
        )
        columns.append((ahead - behind) / (2 * step))
    return torch.stack(columns, dim=-1)


def predicted_variance(jacobian: Tensor, covariance: Tensor) -> Tensor:
    """Mean over queries of tr(J Sigma J'), (M, ...): standardised variance of predictions due to phi.

    Args:
        jacobian: (M, B, Q, do, h).
        covariance: (M, B, ..., h, h) of phi, with any number of candidates before the last two.
    """
    summed = torch.einsum("mbqoh,mbqok->mbhk", jacobian, jacobian) / jacobian.shape[2]
    extra = covariance.dim() - summed.dim()
    summed = summed.reshape(*summed.shape[:2], *(1,) * extra, *summed.shape[2:])
    return (summed * covariance).sum((-1, -2))


@torch.no_grad()
def variance_after(
    method: Kalman, belief: KalmanBelief, jacobian: Tensor, state: Tensor, action: Tensor
) -> Tensor:
    """`predicted_variance` after each of C candidate hits, (M, B, C), before any of them is made.

    The covariance after the update depends on the observed outcome only through the precision that the
    measurement network computes; it is evaluated at the outcome that the belief predicts.

    Args:
        method: whose belief it is.
        belief: current belief.
        jacobian: of the queries of interest, from `outcome_jacobian`.
        state: of the candidates, (M, B, C, ds).
        action: of the candidates, (M, B, C, latent).
    """
    expected = method.predict(belief, state, action)
    _, H = method.whiten(*method.measure(state, action, expected))
    models, tasks, candidates, k, h = H.shape
    mean = belief.mean[:, :, None].expand(models, tasks, candidates, h)
    covariance = belief.covariance[:, :, None].expand(models, tasks, candidates, h, h)
    measured = mean.new_zeros(models, tasks, candidates, k)  # the covariance does not depend on it
    step = kalman_step(mean, covariance, measured, H, method.settings.drift)
    return predicted_variance(jacobian, step.covariance)
