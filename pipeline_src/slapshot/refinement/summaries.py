"""Summary statistics of a sequence of hits: a model's belief about phi, and its prediction error."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.method import AdaptationMethod
from slapshot.arrays import Array
from slapshot.rollouts.reading import Sequences

LEARNED = 4  # hits after which the error is due to noise rather than to incomplete adaptation
_NAMES = ("state", "action", "outcome")


@dataclass(frozen=True)
class Summaries:
    """Summaries of B sequences by M models.

    Attributes:
        hidden: (M, B, h) after the last hit.
        log_error: (M, B) of the mean squared distance, standardised, between predictions of hits past the
            first LEARNED and what was observed.
    """

    hidden: Array
    log_error: Array

    def only(self, sequence: int) -> "Summaries":
        """Summaries of one sequence, (M, 1, ...)."""
        return Summaries(self.hidden[:, [sequence]], self.log_error[:, [sequence]])


@torch.no_grad()
def summarise(method: AdaptationMethod[Any], state: Tensor, action: Tensor, observed: Tensor) -> Summaries:
    """Adapt all models to the same standardised sequences (B, N, d)."""
    many = [x.expand(method.models, *x.shape) for x in (state, action, observed)]
    predicted = method.sequence_predictions(*many)
    off = (predicted - many[2])[:, :, LEARNED:].square().sum(-1).mean(-1)
    hidden = method.hidden(method.adapt(*many)[-1])
    return Summaries(hidden.double().numpy(), off.double().log().numpy())


def summarise_simulated(
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
    data: Sequences,
    samples: int,
    noise_variance_max: float,
    rng: np.random.Generator,
) -> tuple[Summaries, Summaries, Array]:
    """Summarise two sequences of each condition, made of different hits, with noise as in training.

    Returns:
        The summaries of both, and the noise variances (B, 2) of their observations.

    Raises:
        ValueError: a condition has fewer than 2 `samples` hits.
    """
    count, hits, size = data.outcome.shape
    if 2 * samples > hits:
        raise ValueError(f"{hits} hits of a condition are not twice {samples}")
    order = rng.permuted(np.tile(np.arange(hits), (count, 1)), axis=1)
    variances = rng.uniform(0, noise_variance_max, (count, size))
    found = []
    for begin in (0, samples):
        rows = order[:, begin : begin + samples, None]
        state, action, outcome = (
            standardiser.standardise(name, np.take_along_axis(getattr(data, name), rows, 1))
            for name in _NAMES
        )
        noise = np.sqrt(variances)[:, None] * rng.normal(size=outcome.shape)
        found.append(summarise(method, state, action, outcome + torch.as_tensor(noise, dtype=torch.float32)))
    return found[0], found[1], variances
