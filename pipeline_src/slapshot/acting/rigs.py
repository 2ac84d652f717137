"""A rig to act on: safe commands from latents, and the tensors that an ensemble wants."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.lab.live import LiveRig
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyCheck
from slapshot.trajectories.vae import TrajectoryVae

Array = NDArray[np.float64]

_SHRINK = 0.9  # of a latent that is not safe, until it is: 0 stands for the demonstrations' middle
_MOST_SHRINKING = 40


class Robot:
    """Executes latents on a live rig."""

    def __init__(self, rig: LiveRig, model: TrajectoryVae, check: SafetyCheck) -> None:
        self._rig, self._model, self._check = rig, model, check

    def hit(self, latents: Array, object_ids: Sequence[str], rng: np.random.Generator) -> Array:
        """(n, 2) m, where objects are seen to rest; a latent that is not safe is shrunk until it is."""
        return self._rig.execute([self.safe(latent)[1] for latent in latents], object_ids, rng)

    def certain(self, latents: Array, object_ids: Sequence[str]) -> Array:
        """(n, 2) m, where they would rest without chance: what an oracle knows."""
        return self._rig.without_chance([self.safe(latent)[1] for latent in latents], object_ids)

    def safe(self, latent: Array) -> tuple[Array, Motion]:
        """The latent, or the first safe one on its way to 0, and its motion."""
        for _ in range(_MOST_SHRINKING):
            motion = self._model.motion(latent)
            if self._check.report(motion).safe:
                break
            latent = _SHRINK * latent
        return latent, motion

    def candidates(self, count: int, rng: np.random.Generator) -> Array:
        """(count, latent) safe latents from the unit Gaussian."""
        found: list[Array] = []
        while len(found) < count:
            latent = rng.normal(size=self._model.sizes.latent)
            if self._check.report(self._model.motion(latent)).safe:
                found.append(latent)
        return np.array(found)


def batched(values: NDArray[np.floating] | Tensor, models: int) -> Tensor:
    """(M, ...) of values (...) that all models share."""
    tensor = torch.as_tensor(np.asarray(values), dtype=torch.float32)
    return tensor.expand(models, *tensor.shape)
