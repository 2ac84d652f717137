"""Gaussian measurement from the outputs of the measurement network, and its whitened form."""

import torch
from torch import Tensor
from torch.nn import functional

from slapshot.adaptation.kalman_filter import times

LARGEST_FACTOR = 100.0
"""Bound on the entries of L in Sigma_z^-1 = L L'. The prior's variance starts at 1 in the same
coordinates, so one sample can shrink a standard deviation about a hundredfold. Without a bound, P
could come to span more than the seven digits of float32."""


def measurement_size(k: int) -> int:
    """Number of outputs that `unpack` takes: mu_z and a lower triangle."""
    return k + k * (k + 1) // 2


def unpack(outputs: Tensor, k: int) -> tuple[Tensor, Tensor]:
    """mu_z (..., k) and L (..., k, k) with Sigma_z^-1 = L L', from outputs (..., `measurement_size(k)`)."""
    mean, packed = outputs.split([k, outputs.shape[-1] - k], dim=-1)
    return mean, positive_diagonal(square(packed.clamp(-LARGEST_FACTOR, LARGEST_FACTOR), k))


def square(packed: Tensor, k: int) -> Tensor:
    """Unpack k (k + 1) / 2 values to the lower triangle, diagonal included, of a matrix (..., k, k).

    Indexing with tril_indices would do the same, with a slower gradient.
    """
    return torch.cat([packed[..., k:], packed.flip(-1)], dim=-1).unflatten(-1, (k, k))


def positive_diagonal(raw: Tensor) -> Tensor:
    """Lower triangle of raw (..., h, h) with its diagonal made positive by softplus."""
    below = torch.ones(raw.shape[-2:], dtype=raw.dtype, device=raw.device).tril(-1)
    return raw * below + torch.diag_embed(functional.softplus(raw.diagonal(dim1=-2, dim2=-1)))


def whiten(mean: Tensor, L: Tensor, C: Tensor) -> tuple[Tensor, Tensor]:
    """Return y = L' mu_z (M, ..., k) and H = L' C_z (M, ..., k, h), the arguments of `kalman_step`.

    Args:
        mean: mu_z, (M, ..., k).
        L: factor, (M, ..., k, k).
        C: C_z of each model, (M, k, h).
    """
    # One product per model rather than one per sample.
    H = (L.mT.reshape(len(L), -1, L.shape[-1]) @ C).view(*L.shape[:-1], C.shape[-1])
    return times(L.mT, mean), H
