"""Latents that hit targets: by gradient through the adapted models, taking their uncertainty into account.

The expected squared distance of the rest point from a target t is

    E |s' - t|^2 = |E f(s, a, phi) - t|^2 + tr Cov f(s, a, phi),   phi ~ N(mu_phi, Sigma_phi),

so that of two latents with like means the one is chosen whose outcome is surer. The expectation is over the
models of the ensemble, too: where training data are thin they disagree, and a search that trusts one of them
finds the places where that one is wrong. What scatters from hit to hit, whatever the latent, is a constant.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.method import AdaptationMethod

LARGEST_LATENT = 2.0  # of a unit Gaussian's components: farther out training data are thin
_KEPT = 4  # candidates that the gradient goes on from
_STEPS = 60
_STEP_SIZE = 0.05

Cost = Callable[[Tensor], Tensor]
"""(B, T, C) of standardised actions (B, T, C, latent): what is to be small for each of T targets."""


def expected_cost(method: Kalman, phi: Tensor, state: Tensor, action: Tensor, target: Tensor) -> Tensor:
    """Mean squared distance over draws of phi, (M, B, T, C), standardised.

    Args:
        method: whose belief phi is drawn from.
        phi: (M, B, draws, h).
        state: (ds,).
        action: (M, B, T, C, latent), standardised.
        target: (M, B, T, do), standardised.
    """
    outcome = method.outcome(phi[:, :, None, None], state, action[..., None, :])
    return (outcome - target[:, :, :, None, None]).square().sum(-1).mean(-1)


def believed_cost(method: Kalman, phi: Tensor, state: Tensor, target: Tensor) -> Cost:
    """`expected_cost` as the mean over models, for targets (B, T, do) that all of them share."""

    def cost(action: Tensor) -> Tensor:
        many, wanted = (x.expand(method.models, *x.shape) for x in (action, target))
        return expected_cost(method, phi, state, many, wanted).mean(0)

    return cost


def predicted_cost(method: AdaptationMethod[Any], belief: Any, state: Tensor, target: Tensor) -> Cost:
    """Squared distance of predicted rest points, mean over models: of a method that knows no uncertainty."""

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
        targets: T, of each task.
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
    """(B, T, latent): of actions (B, T, C, latent) those of least cost (B, T, C)."""
    lowest = cost.argmin(-1, keepdim=True)
    return action.gather(2, lowest[..., None].expand(*lowest.shape, action.shape[-1]))[:, :, 0]


def draw_phi(method: Kalman, belief: KalmanBelief, draws: int, generator: torch.Generator) -> Tensor:
    """(M, B, draws, h) from the beliefs; a single one is their mean."""
    return belief.mean[:, :, None] if draws == 1 else method.sample_phi(belief, draws, generator)
