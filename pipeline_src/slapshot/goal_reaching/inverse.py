"""The inverse model: a network from a target and a belief to the latent that should hit it.

Trained through the adapted forward model, on beliefs and targets of simulated conditions. It minimises the
expected cost that `choose_by_gradient` minimises for each hit, so it amortises that optimisation.
"""

from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from slapshot.adaptation.data import SequenceSampler
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.layers import StackedMLP
from slapshot.config.acting import Inverse
from slapshot.config.methods import Training
from slapshot.goal_reaching.expected_cost import LARGEST_LATENT, expected_cost
from slapshot.progress import progress

FILE = "inverse.safetensors"
_LEAST_VARIANCE = 1e-6  # lower bound on variances of phi before the logarithm
_TARGETS = 8  # targets of each task in a training step


@dataclass(frozen=True)
class InverseSizes:
    """Dimensions of the target, of phi, of the latent, and of the hidden layers."""

    target: int
    phi: int
    latent: int
    hidden: tuple[int, ...]


class InverseModel(nn.Module):
    """M networks (target, mean and log variances of phi) -> latent, within +-LARGEST_LATENT."""

    def __init__(self, models: int, sizes: InverseSizes, generator: torch.Generator) -> None:
        super().__init__()
        self.net = StackedMLP(models, [sizes.target + 2 * sizes.phi, *sizes.hidden, sizes.latent], generator)

    def forward(self, belief: KalmanBelief, target: Tensor) -> Tensor:
        """Latents (M, B, T, latent) in their own units, for standardised targets (M, B, T, do)."""
        spread = belief.covariance.diagonal(dim1=-2, dim2=-1).clamp_min(_LEAST_VARIANCE).log()
        known = torch.cat([belief.mean, spread], dim=-1)[:, :, None]
        inputs = torch.cat([target, known.expand(*target.shape[:-1], known.shape[-1])], dim=-1)
        return LARGEST_LATENT * torch.tanh(self.net(inputs))

    def save(self, folder: Path) -> None:
        """Write inverse.safetensors."""
        save_file(self.state_dict(), folder / FILE)


def load_inverse(folder: Path, method: Kalman, hidden: tuple[int, ...]) -> InverseModel:
    """Read what `save` wrote, for an ensemble of `method`."""
    model = InverseModel(method.models, _sizes(method, hidden), torch.Generator().manual_seed(0))
    model.load_state_dict(load_file(folder / FILE))
    return model.eval()


def _sizes(method: Kalman, hidden: tuple[int, ...]) -> InverseSizes:
    return InverseSizes(method.sizes.outcome, method.settings.latent, method.sizes.action, hidden)


def train_inverse(
    method: Kalman,
    sampler: SequenceSampler,
    to_action: "Standardisation",
    settings: Inverse,
    training: Training,
    generator: torch.Generator,
) -> tuple[InverseModel, list[float]]:
    """Fit an inverse model to a trained ensemble, whose weights are not changed.

    Args:
        method: the ensemble.
        sampler: of training sequences.
        to_action: from latents to standardised actions.
        settings: of the network and its training.
        training: settings that the ensemble was trained with.
        generator: source of randomness.

    Returns:
        The model, and the mean expected squared distance (standardised) at every step.
    """
    inverse = InverseModel(method.models, _sizes(method, settings.hidden), generator)
    optimiser = torch.optim.Adam(inverse.parameters(), lr=settings.learning_rate)
    steps = settings.steps
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.learning_rate, total_steps=steps, pct_start=0.1
    )
    losses = []
    for _ in progress(range(steps), steps, "inverse model"):
        batch = sampler.draw(
            method.models,
            training.tasks,
            training.sequence,
            training.noise_variance_max,
            generator,
        )
        seen = int(torch.randint(training.sequence, (), generator=generator))
        with torch.no_grad():
            adapted = (x[:, :, :seen] for x in (batch.state, batch.action, batch.observed))
            belief = method.adapt(*adapted)[-1]
            phi = method.sample_phi(belief, settings.draws, generator)
        # Targets are rest points of hits under the same condition, so they can be reached.
        others = torch.randperm(training.sequence, generator=generator)[:_TARGETS]
        target = batch.outcome[:, :, others]
        action = to_action(inverse(belief, target))[:, :, :, None]
        state = batch.state[0, 0, 0]  # the start position is the same for all hits
        loss = expected_cost(method, phi, state, action, target).mean((1, 2, 3)).sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        losses.append(float(loss.detach()) / method.models)
    return inverse.eval(), losses


@dataclass(frozen=True)
class Standardisation:
    """Latents (..., latent) to standardised actions, by mean and standard deviation of training actions."""

    mean: Tensor
    scale: Tensor

    def __call__(self, latent: Tensor) -> Tensor:
        """Standardise."""
        return (latent - self.mean) / self.scale

    def back(self, action: Tensor) -> Tensor:
        """Undo the standardisation."""
        return action * self.scale + self.mean
