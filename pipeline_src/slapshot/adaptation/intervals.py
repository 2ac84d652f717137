"""Prediction intervals from sampled phi, and their calibration.

The belief of the Kalman filter is Gaussian in phi. Samples of phi, each passed through the prediction
network, give a cloud of predicted outcomes (paper, section "Linear regression" and figure 1); its mean and
covariance define an ellipse. Training by squared error does not determine the scale of the belief, so the
radius of the ellipse that covers a share p of outcomes is measured on validation data, never assumed.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.method import AdaptationMethod
from slapshot.errors import InputError

# m²: keeps a covariance invertible when its few sampled outcomes agree; no camera resolves a millimetre.
_LEAST_VARIANCE = 1e-6


@runtime_checkable
class SamplesPhi(Protocol):
    """Interface of methods with intervals: a belief to draw phi from, and a prediction for each phi."""

    models: int

    def sample_phi(self, belief: Any, samples: int, generator: torch.Generator) -> Tensor:
        """(M, B, samples, h) draws from the belief."""

    def outcome(self, phi: Tensor, state: Tensor, action: Tensor) -> Tensor:
        """(M, ..., do) predicted outcome for given phi; the leading dimensions broadcast."""


@dataclass(frozen=True)
class Predictive:
    """Predicted outcomes, in m.

    Attributes:
        mean: (M, B, Q, do), the prediction at the belief's mean.
        covariance: (M, B, Q, do, do) of the outcomes at sampled phi, about their own mean.
    """

    mean: Tensor
    covariance: Tensor

    def squared_distance(self, truth: Tensor) -> Tensor:
        """(M, B, Q) squared Mahalanobis distance of outcomes (B, Q, do) from the prediction."""
        off = truth.double() - self.mean.double()
        return (off * torch.linalg.solve(self.covariance.double(), off)).sum(-1)

    def area(self) -> Tensor:
        """(M, B, Q) area in m² of the ellipse of Mahalanobis radius 1, for outcomes in the plane."""
        return torch.pi * torch.linalg.det(self.covariance.double()).sqrt()


@torch.no_grad()
def predictive(
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
    belief: Any,
    state: Tensor,
    action: Tensor,
    draws: int,
    generator: torch.Generator,
) -> Predictive:
    """Predict queries (M, B, Q, d) at the mean of phi, with the covariance over `draws` samples of phi.

    Raises:
        InputError: the method has no belief to sample from.
    """
    if not isinstance(method, SamplesPhi):
        raise InputError(
            f"uncertainty.method: {type(method).__name__} has no belief to draw phi from; use kalman"
        )
    mean = standardiser.restore("outcome", method.predict(belief, state, action))
    phi = method.sample_phi(belief, draws, generator)
    # One query at a time: all at once would need gigabytes.
    covariances = []
    for q in range(state.shape[2]):
        one = slice(q, q + 1)
        cloud = standardiser.restore("outcome", method.outcome(phi, state[:, :, one], action[:, :, one]))
        centred = (cloud - cloud.mean(2, keepdim=True)).double()
        covariances.append(centred.mT @ centred / (draws - 1))
    covariance = torch.stack(covariances, dim=2)
    least = _LEAST_VARIANCE * torch.eye(covariance.shape[-1], dtype=covariance.dtype)
    return Predictive(mean, covariance + least)


def raw_radius2(level: float) -> float:
    """Squared radius that would cover `level` if outcomes in the plane were Gaussian: -2 ln(1 - p)."""
    return -2 * float(np.log1p(-level))


def calibrate(distances: NDArray[np.floating], level: float) -> NDArray[np.float64]:
    """(M) squared radius that covers `level` of the squared distances (M, B, Q) of each model."""
    return np.quantile(distances.reshape(len(distances), -1), level, axis=1)


@dataclass(frozen=True)
class Calibration:
    """Squared radii measured on validation data.

    Attributes:
        table: rows of model, samples, level, radius2.
    """

    table: pd.DataFrame

    def radius2(self, model: int, samples: int, level: float) -> float:
        """Squared radius after the largest measured number of samples that does not exceed `samples`."""
        rows = self.table[(self.table["model"] == model) & (self.table["level"] == level)]
        known = rows[rows["samples"] <= samples].sort_values("samples")
        return float(known["radius2"].to_numpy()[-1])
