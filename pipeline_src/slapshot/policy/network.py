"""The policy: a Gaussian over latents whose mean is a network of the target."""

import math
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.distributions import Independent, Normal
from torch.func import functional_call

from slapshot.adaptation.layers import StackedMLP
from slapshot.config.acting import PolicyTraining

FILE = "policy.safetensors"
_SD_BEFORE = 0.7  # standard deviation of latents before training; that of demonstrations is 1

Parameters = dict[str, Tensor]
"""Name -> (B, ...): the policy's parameters for each of B tasks."""


class GaussianPolicy(nn.Module):
    """pi(z | t) = N(mu(t), diag(sd^2)) over latents z for standardised targets t.

    Parameters have a leading dimension of tasks, which is 1 before adaptation.
    """

    def __init__(self, target: int, latent: int, settings: PolicyTraining, generator: torch.Generator):
        """Draw weights.

        Args:
            target: dimension of a target.
            latent: dimension of a latent.
            settings: widths of its network, and the step size of an adaptation before training.
            generator: source of randomness.
        """
        super().__init__()
        self.mean = StackedMLP(1, [target, *settings.hidden, latent], generator)
        self.log_sd = nn.Parameter(torch.full((1, 1, latent), math.log(_SD_BEFORE)))
        # The logarithm keeps the step size positive. It is learned; adaptation does not change it.
        self.log_step_size = nn.Parameter(torch.tensor(math.log(settings.step_size)))

    def unadapted(self, tasks: int) -> Parameters:
        """theta_0, the same for B = `tasks` tasks."""
        shared = {"log_sd": self.log_sd} | {f"mean.{n}": p for n, p in self.mean.named_parameters()}
        return {name: p.expand(tasks, *p.shape[1:]) for name, p in shared.items()}

    def distribution(self, parameters: Parameters, targets: Tensor) -> Independent[Normal]:
        """Distribution of latents (B, K, latent) for targets (B, K, 2)."""
        weights = {n.removeprefix("mean."): p for n, p in parameters.items() if n.startswith("mean.")}
        mean = functional_call(self.mean, weights, (targets,))
        return Independent(Normal(mean, parameters["log_sd"].exp().expand_as(mean)), 1)

    def save(self, folder: Path) -> None:
        """Write policy.safetensors."""
        save_file(self.state_dict(), folder / FILE)


def load_policy(folder: Path, settings: PolicyTraining) -> GaussianPolicy:
    """Read what `save` wrote."""
    tensors = load_file(folder / FILE)
    sizes = tensors["mean.weights.0"].shape[1], tensors["log_sd"].shape[2]
    policy = GaussianPolicy(*sizes, settings, torch.Generator().manual_seed(0))
    policy.load_state_dict(tensors)
    return policy
