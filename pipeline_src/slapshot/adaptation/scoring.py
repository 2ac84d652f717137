"""Error against samples seen: adapt on some hits, score on others."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.method import AdaptationMethod

Array = NDArray[np.floating]


@torch.no_grad()
def errors_against_samples(
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
    adapt: dict[str, Array],
    query: dict[str, Array],
    noise: Array | None = None,
) -> Array:
    """Distance between predicted and true outcome, in the outcome's unit, after 0, 1, ..., N samples.

    Args:
        method: an ensemble of M models.
        standardiser: of the ensemble's training data.
        adapt: state, action and outcome (B, N, size) of the hits to adapt to.
        query: state, action and outcome (B, Q, size) of other hits of the same tasks.
        noise: (B, N, size), added to the standardised outcomes to adapt to.

    Returns:
        (M, B, N + 1), the mean over queries.
    """

    def tensor(values: dict[str, Array], name: str) -> torch.Tensor:
        standardised = standardiser.standardise(name, values[name])
        return standardised.expand(method.models, *standardised.shape)

    observed = tensor(adapt, "outcome")
    if noise is not None:
        observed = observed + torch.as_tensor(noise, dtype=torch.float32)
    beliefs = method.adapt(tensor(adapt, "state"), tensor(adapt, "action"), observed)
    truth = torch.as_tensor(query["outcome"], dtype=torch.float32)
    state, action = tensor(query, "state"), tensor(query, "action")
    errors = [
        (standardiser.restore("outcome", method.predict(belief, state, action)) - truth).norm(dim=-1).mean(-1)
        for belief in beliefs
    ]
    return torch.stack(errors, dim=-1).numpy()
