"""Input of the methods: standardised tensors, and sequences with noisy outcomes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file, save_file
from torch import Tensor

from slapshot.rollouts.reading import Sequences

# A component that hardly varies (such as a fixed start position) is centred but not scaled up.
_CONSTANT = 1e-6


@dataclass(frozen=True)
class Standardiser:
    """Mean and standard deviation of state, action and outcome over the training data.

    Attributes:
        mean, scale: name -> (size,) tensors in the data's units.
    """

    mean: dict[str, Tensor]
    scale: dict[str, Tensor]

    @classmethod
    def fit(cls, data: Sequences) -> "Standardiser":
        """Take mean and standard deviation over all hits of all conditions."""
        mean, scale = {}, {}
        for name in ("state", "action", "outcome"):
            flat = torch.as_tensor(getattr(data, name)).flatten(0, 1).double()
            mean[name] = flat.mean(0).float()
            spread = flat.std(0).float()
            scale[name] = torch.where(spread > _CONSTANT, spread, torch.ones_like(spread))
        return cls(mean, scale)

    def standardise(self, name: str, values: NDArray[np.floating] | Tensor) -> Tensor:
        """(..., size) to zero mean and unit variance over the training data."""
        return (torch.as_tensor(values, dtype=torch.float32) - self.mean[name]) / self.scale[name]

    def restore(self, name: str, values: Tensor) -> Tensor:
        """Undo `standardise`: (..., size) in the data's units."""
        return values * self.scale[name].to(values) + self.mean[name].to(values)

    def save(self, path: Path) -> None:
        """Write a safetensors file."""
        tensors = {f"mean.{k}": v for k, v in self.mean.items()}
        save_file(tensors | {f"scale.{k}": v for k, v in self.scale.items()}, path)

    @classmethod
    def load(cls, path: Path) -> "Standardiser":
        """Read what `save` wrote."""
        parts: dict[str, dict[str, Tensor]] = {"mean": {}, "scale": {}}
        for key, value in load_file(path).items():
            part, name = key.split(".")
            parts[part][name] = value
        return cls(**parts)


@dataclass(frozen=True)
class Batch:
    """Sequences for M models: tensors (M, B, N, size), standardised.

    Attributes:
        state, action: inputs.
        observed: noisy outcomes, what the model adapts to.
        outcome: noiseless outcomes, what it must predict.
    """

    state: Tensor
    action: Tensor
    observed: Tensor
    outcome: Tensor


class SequenceSampler:
    """Draws training sequences: random conditions, random order of their hits, random noise levels."""

    def __init__(self, data: Sequences, standardiser: Standardiser, device: torch.device) -> None:
        self._tensors = {
            name: standardiser.standardise(name, getattr(data, name)).to(device)
            for name in ("state", "action", "outcome")
        }
        self._device = device

    def draw(
        self,
        models: int,
        tasks: int,
        length: int,
        noise_variance_max: float,
        generator: torch.Generator,
    ) -> Batch:
        """Draw independent sequences for every model; hits of a sequence are drawn without replacement.

        Noise: diag(Sigma_s) ~ U(0, noise_variance_max) per task and component (paper, eq. sigma_s),
        in units of the standardised outcome.

        Args:
            models: M.
            tasks: B.
            length: N.
            noise_variance_max: upper bound of the noise variance.
            generator: on the CPU, so that a seed gives the same draws on every device.
        """
        conditions, hits, size = self._tensors["outcome"].shape
        rows = torch.randint(conditions, (models, tasks, 1), generator=generator)
        order = torch.rand(models, tasks, hits, generator=generator).argsort(-1)[..., :length]
        variance = torch.rand(models, tasks, 1, size, generator=generator) * noise_variance_max
        noise = torch.randn(models, tasks, length, size, generator=generator) * variance.sqrt()
        rows, order = rows.to(self._device), order.to(self._device)
        state, action, outcome = (self._tensors[name][rows, order] for name in ("state", "action", "outcome"))
        return Batch(state, action, outcome + noise.to(self._device), outcome)
