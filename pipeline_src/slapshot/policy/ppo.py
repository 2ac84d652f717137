"""Meta-training of the policy (the outer loop): PPO on hits made after each number of updates."""

from collections.abc import Callable, Iterator, Mapping

import pandas as pd
import torch
from torch import Tensor

from slapshot.config.acting import PolicyTraining
from slapshot.policy.adapt import OwnHits, ratio, update
from slapshot.policy.network import GaussianPolicy
from slapshot.progress import progress

_CLIP = 0.2  # of PPO's objective (Schulman et al. 2017)
_GRADIENT_NORM = 1.0

Act = Callable[[Tensor, Tensor], Tensor]
"""From conditions (B,) and latents (B, K, latent) to rest points (B, K, 2), standardised."""


def hits_of(
    policy: GaussianPolicy, conditions: Tensor, targets: Tensor, act: Act, generator: torch.Generator
) -> list[OwnHits]:
    """On-policy hits of tasks before and after each update.

    Args:
        policy: before any update.
        conditions: (B,) of the tasks.
        targets: (U + 1, B, K, 2) for the K hits after 0, 1, ..., U updates.
        act: the simulator.
        generator: source of randomness.
    """
    parameters = policy.unadapted(len(conditions))
    batches: list[OwnHits] = []
    for wanted in targets:
        if batches:
            parameters = update(policy, parameters, batches[-1], differentiable=False)
        batches.append(own_hits(policy, parameters, wanted, lambda z: act(conditions, z), generator))
    return batches


@torch.no_grad()
def own_hits(
    policy: GaussianPolicy,
    parameters: Mapping[str, Tensor],
    targets: Tensor,
    act: Callable[[Tensor], Tensor],
    generator: torch.Generator,
) -> OwnHits:
    """Hits at targets (B, K, 2) with latents drawn from the policy."""
    distribution = policy.distribution(dict(parameters), targets)
    noise = torch.randn(distribution.mean.shape, generator=generator)
    latents = distribution.mean + distribution.stddev * noise
    distance = (act(latents) - targets).norm(dim=-1)
    return OwnHits(targets, latents, distribution.log_prob(latents), -distance)


def objective(policy: GaussianPolicy, batches: list[OwnHits]) -> Tensor:
    """PPO's clipped objective of the policy after each number of updates, to be maximised.

    Hits before the last update count, too: otherwise nothing would keep the unadapted policy close enough to
    the targets for few updates to reach them.
    """
    parameters, gains = policy.unadapted(len(batches[0].targets)), []
    for number, hits in enumerate(batches):
        if number:
            parameters = update(policy, parameters, batches[number - 1], differentiable=True)
        change = ratio(policy, parameters, hits)
        advantage = hits.advantages / hits.advantages.std().clamp_min(1e-6)
        clipped = change.clamp(1 - _CLIP, 1 + _CLIP)
        gains.append(torch.minimum(change * advantage, clipped * advantage).mean())
    return torch.stack(gains).mean()


def train(
    policy: GaussianPolicy,
    tasks: Iterator[tuple[Tensor, Tensor]],
    iterations: int,
    act: Act,
    settings: PolicyTraining,
    generator: torch.Generator,
) -> pd.DataFrame:
    """Train on-policy; no hit is used in more than one iteration.

    Args:
        policy: trained in place.
        tasks: conditions (B,) and targets (U + 1, B, K, 2) of each iteration.
        iterations: how many.
        act: the simulator.
        settings: of the optimiser.
        generator: source of randomness.

    Returns:
        Rows iteration, updates, distance (mean, in standard deviations of outcomes).
    """
    optimiser = torch.optim.Adam(policy.parameters(), lr=settings.learning_rate)
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.1, iterations)
    rows = []
    for iteration in progress(range(iterations), iterations, "policy: iterations"):
        batches = hits_of(policy, *next(tasks), act, generator)
        for _ in range(settings.epochs):
            optimiser.zero_grad()
            (-objective(policy, batches)).backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), _GRADIENT_NORM)
            optimiser.step()
        schedule.step()
        rows += [
            {"iteration": iteration, "updates": u, "distance": -float(hits.rewards.mean())}
            for u, hits in enumerate(batches)
        ]
    return pd.DataFrame(rows)
