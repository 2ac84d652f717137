"""Adapting a policy to a task by gradient steps on its own hits (the inner loop).

theta_u+1 = theta_u + alpha grad_theta 1/K sum_k (r_k - r~) pi_theta(z_k | t_k) / pi_theta_u(z_k | t_k)

for the K hits made with theta_u, where the reward r is minus the distance to the target, and r~ its mean
over them. At theta_u this is the policy gradient; written as a ratio, its second derivatives are also correct
(Rothfuss et al. 2018, which the paper cites), and training differentiates through all updates.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from slapshot.policy.network import GaussianPolicy, Parameters

LARGEST_GRADIENT = 10.0  # bound on the norm of a task's gradient, as in the MAML baseline


@dataclass(frozen=True)
class OwnHits:
    """K hits of each of B tasks, made by one policy.

    Attributes:
        targets: (B, K, 2), standardised as outcomes are.
        latents: (B, K, latent) drawn from the policy.
        log_probability: (B, K) log density of the drawn latents.
        rewards: (B, K) minus the distance to the target, in standard deviations of outcomes.
    """

    targets: Tensor
    latents: Tensor
    log_probability: Tensor
    rewards: Tensor

    @property
    def advantages(self) -> Tensor:
        """(B, K) rewards minus their mean over the task."""
        return self.rewards - self.rewards.mean(1, keepdim=True)


def ratio(policy: GaussianPolicy, parameters: Parameters, hits: OwnHits) -> Tensor:
    """(B, K) probability ratio of the hits' latents: under `parameters`, over that when they were drawn."""
    now = policy.distribution(parameters, hits.targets).log_prob(hits.latents)
    return (now - hits.log_probability).exp()


def update(policy: GaussianPolicy, parameters: Parameters, hits: OwnHits, differentiable: bool) -> Parameters:
    """One gradient step for each task.

    Args:
        policy: the policy that has these parameters.
        parameters: with which the hits were made.
        hits: of the tasks.
        differentiable: keep the graph, for training through the step.
    """
    gain = (ratio(policy, parameters, hits) * hits.advantages).mean(1).sum()
    gradients = torch.autograd.grad(gain, list(parameters.values()), create_graph=differentiable)
    flat = torch.cat([g.flatten(1) for g in gradients], dim=1)
    # The lower bound keeps the derivative of the root finite where all rewards are equal.
    norm = flat.square().sum(1).clamp_min(1e-12).sqrt()
    step = policy.log_step_size.exp() * (LARGEST_GRADIENT / norm).clamp(max=1.0)
    moved = {
        name: p + step.view(-1, *[1] * (p.dim() - 1)) * g
        for (name, p), g in zip(parameters.items(), gradients, strict=True)
    }
    return moved if differentiable else {n: p.detach().requires_grad_() for n, p in moved.items()}
