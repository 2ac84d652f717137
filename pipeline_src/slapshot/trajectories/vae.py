"""A variational autoencoder over waypoints: sampling its unit-Gaussian latent gives a trajectory (S5).

Loss per trajectory: |x - decode(z)|^2 / (2 noise^2) + KL(q(z|x) || N(0, I)), z drawn from q(z|x).
"""

import json
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from slapshot.arrays import Array
from slapshot.trajectories.motion import Motion


@dataclass(frozen=True)
class VaeSizes:
    """Dimensions of the model.

    Attributes:
        waypoints: number of waypoints of a trajectory.
        joints: number of joints of the arm.
        latent: dimension of the action.
        hidden: widths of the hidden layers, the same in encoder and decoder.
        duration: s, of every trajectory.
    """

    waypoints: int
    joints: int
    latent: int
    hidden: tuple[int, ...]
    duration: float


class TrajectoryVae(nn.Module):
    """Encoder and decoder between waypoints (waypoints, joints) in rad and a latent."""

    def __init__(self, sizes: VaeSizes) -> None:
        super().__init__()
        self.sizes = sizes
        flat = sizes.waypoints * sizes.joints
        self.encoder = _mlp([flat, *sizes.hidden, 2 * sizes.latent])
        self.decoder = _mlp([sizes.latent, *reversed(sizes.hidden), flat])
        self.register_buffer("mean", torch.zeros(flat))
        self.register_buffer("scale", torch.ones(flat))
        self.register_buffer("latent_mean", torch.zeros(sizes.latent))
        self.register_buffer("latent_sd", torch.ones(sizes.latent))
        self.mean: Tensor
        self.scale: Tensor
        self.latent_mean: Tensor
        self.latent_sd: Tensor

    def set_normalisation(self, flat: Tensor) -> None:
        """Set mean and scale from the training data's waypoints (count, waypoints * joints)."""
        self.mean.copy_(flat.mean(0))
        self.scale.copy_(flat.std(0).clamp_min(1e-3))

    @torch.no_grad()
    def standardise_latent(self, flat: Tensor) -> None:
        """Shift and scale each latent dimension so that the demonstrations have mean 0 and variance 1.

        With a small decoder variance the KL term is too weak to ensure this. Reconstructions do not change.
        """
        mean, log_variance = self.encode(flat)
        shift, spread = mean.mean(0), (mean.var(0) + log_variance.exp().mean(0)).sqrt()
        self.latent_mean.add_(shift * self.latent_sd)
        self.latent_sd.mul_(spread)

    def encode(self, flat: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance, (count, latent) each."""
        mean, log_variance = self.encoder((flat - self.mean) / self.scale).chunk(2, dim=-1)
        log_variance = log_variance.clamp(-20, 2) - 2 * self.latent_sd.log()
        return (mean - self.latent_mean) / self.latent_sd, log_variance

    def decode(self, latent: Tensor) -> Tensor:
        """Flat waypoints (count, waypoints * joints) in rad."""
        return self.decoder(latent * self.latent_sd + self.latent_mean) * self.scale + self.mean

    def loss(self, flat: Tensor, noise: float, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Reconstruction and KL terms, nats per trajectory.

        Args:
            flat: (count, waypoints * joints) in rad.
            noise: sd in rad of the decoder's Gaussian.
            generator: source of randomness.
        """
        mean, log_variance = self.encode(flat)
        sample = torch.randn(mean.shape, generator=generator)
        decoded = self.decode(mean + sample * (log_variance / 2).exp())
        reconstruction = ((decoded - flat) ** 2).sum(1).mean() / (2 * noise**2)
        return reconstruction, self.divergence(mean, log_variance).sum(1).mean()

    @staticmethod
    def divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
        """KL(q || N(0, 1)) in nats, elementwise."""
        return (mean**2 + log_variance.exp() - 1 - log_variance) / 2

    def motion(self, latent: Array) -> Motion:
        """The motion decoded from a latent (latent,)."""
        return Motion.through(self.waypoints(latent[None])[0], self.sizes.duration)

    @torch.no_grad()
    def waypoints(self, latents: Array) -> Array:
        """(count, waypoints, joints) in rad, decoded from latents (count, latent)."""
        flat = self.decode(torch.as_tensor(latents, dtype=torch.float32)).double().numpy()
        return flat.reshape(-1, self.sizes.waypoints, self.sizes.joints)

    @torch.no_grad()
    def latents(self, waypoints: Array) -> Array:
        """(count, latent): the encoder's mean for waypoints (count, waypoints, joints) in rad."""
        flat = torch.as_tensor(waypoints.reshape(len(waypoints), -1), dtype=torch.float32)
        return self.encode(flat)[0].double().numpy()

    def save(self, folder: Path) -> None:
        """Write model.safetensors and model.json."""
        save_file(self.state_dict(), folder / "model.safetensors")
        (folder / "model.json").write_text(json.dumps(asdict(self.sizes), indent=2) + "\n")

    @classmethod
    def load(cls, folder: Path) -> "TrajectoryVae":
        """Read what `save` wrote."""
        raw = json.loads((folder / "model.json").read_text())
        model = cls(VaeSizes(**raw | {"hidden": tuple(raw["hidden"])}))
        model.load_state_dict(load_file(folder / "model.safetensors"))
        return model.eval()


def _mlp(widths: list[int]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for i, (fan_in, fan_out) in enumerate(pairwise(widths)):
        layers += [nn.SiLU()] if i else []
        layers.append(nn.Linear(fan_in, fan_out))
    return nn.Sequential(*layers)
