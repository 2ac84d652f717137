"""Latents that hit targets, by gradient descent on the expected cost under the adapted models.

The expected squared distance of the rest point from a target t is

    E |s' - t|^2 = |E f(s, a, phi) - t|^2 + tr Cov f(s, a, phi),   phi ~ N(mu_phi, Sigma_phi),

so that of two latents with equal means the one with less uncertain outcome is chosen. The expectation is also
over the models of the ensemble: they disagree where training data are sparse, and an optimiser that trusts
one of them exploits its errors. Scatter from hit to hit that does not depend on the latent is a constant.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.method import AdaptationMethod

LARGEST_LATENT = 2.0  # of a unit Gaussian's components: training data are sparse beyond
_KEPT = 4  # best candidates, from which gradient descent starts
_STEPS = 60
_STEP_SIZE = 0.05

Cost = Callable[[Tensor], Tensor]
"""(B, T, C) of standardised actions (B, T, C, latent): what is to be small for each of T targets."""


def expected_cost(method: Kalman, phi: Tensor, state: Tensor, action: Tensor, target: Tensor) -> Tensor:
    """Mean squared distance over draws of phi, (M, B, T, C), standardised.

    Args:
        method: the ensemble that predicts.
        phi: (M, B, draws, h).
        state: (ds,).
        action: (M, B, T, C, latent), standardised.
        target: (M, B, T, do), standardised.
    """
    outcome = method.outcome(phi[:, :, None, None], state, action[..., None, :])
    return (outcome - target[:, :, :, None, None]).square().sum(-1).mean(-1)


def believed_cost(method: Kalman, phi: Tensor, state: Tensor, target: Tensor) -> Cost:
    """Mean of `expected_cost` over models, for targets (B, T, do) common to all models."""

    def cost(action: Tensor) -> Tensor:
        many, wanted = (x.expand(method.models, *x.shape) for x in (action, target))
        return expected_cost(method, phi, state, many, wanted).mean(0)

    return cost


def predicted_cost(method: AdaptationMethod[Any], belief: Any, state: Tensor, target: Tensor) -> Cost:
    """Mean over models of the squared distance of predicted rest points; ignores uncertainty."""

    def cost(action: Tensor) -> Tensor:
        many = action.flatten(1, 2).expand(method.models, action.shape[0], -1, -1)
        outcome = method.predict(belief, state.expand(*many.shape[:3], -1), many)
        off = outcome.unflatten(2, action.shape[1:3]) - target[:, :, None]
        return off.square().sum(-1).mean(0)

    return cost


def choose_by_gradient(
    cost: Cost, candidates: Tensor, tasks: int, targets: int, bounds: tuple[Tensor, Tensor]
) -> Tensor:
    """The best of the candidates for each target, improved by gradient descent on the cost.

    Args:
        cost: of actions.
        candidates: (C, latent) standardised actions.
        tasks: B.
        targets: T, number of targets of each task.
        bounds: lowest and highest standardised action, (latent,) each.

    Returns:
        (B, T, latent) standardised actions.
    """
    with torch.no_grad():
        many = candidates.expand(tasks, targets, *candidates.shape)
        best = cost(many).topk(min(_KEPT, len(candidates)), dim=-1, largest=False).indices
        action = many.gather(2, best[..., None].expand(*best.shape, many.shape[-1])).clone()
    action.requires_grad_()
    optimiser = torch.optim.Adam([action], lr=_STEP_SIZE)
    for _ in range(_STEPS):
        optimiser.zero_grad()
        cost(action).sum().backward()
        optimiser.step()
        with torch.no_grad():
            action.copy_(torch.minimum(torch.maximum(action, bounds[0]), bounds[1]))
    return cheapest(cost(action.detach()), action.detach())


def cheapest(cost: Tensor, action: Tensor) -> Tensor:
    """Actions of least cost, (B, T, latent), among (B, T, C, latent) with costs (B, T, C)."""
    lowest = cost.argmin(-1, keepdim=True)
    return action.gather(2, lowest[..., None].expand(*lowest.shape, action.shape[-1]))[:, :, 0]


def draw_phi(method: Kalman, belief: KalmanBelief, draws: int, generator: torch.Generator) -> Tensor:
    """Samples of phi (M, B, draws, h) from the beliefs; with `draws` = 1, their mean."""
    return belief.mean[:, :, None] if draws == 1 else method.sample_phi(belief, draws, generator)
