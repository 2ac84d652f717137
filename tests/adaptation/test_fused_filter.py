"""The compiled filter against the plain one, in values and gradients, on the sizes that lanes may spoil."""

import math

import pytest
import torch
from slapshot.adaptation.fused_filter import FusedFilterMeans
from slapshot.adaptation.kalman_filter import PlainFilterMeans
from slapshot.adaptation.lanes import WIDTH
from slapshot.adaptation.measurement import LARGEST_FACTOR, measurement_size, unpack, whiten
from torch import Tensor

DRIFT = 0.01

# Models, tasks, samples, k, h: whole blocks of lanes and not, one of everything, k and h that differ and
# that no tile divides, transposed squares with and without a rest.
SIZES = [
    (4, 8, 5, 16, 16),
    (3, 11, 4, 16, 16),
    (1, WIDTH + 1, 3, 4, 4),
    (1, 1, 1, 1, 1),
    (2, WIDTH, 1, 3, 5),
    (3, 7, 6, 2, 7),
    (3, 7, 6, 7, 2),
]


def draw(M, B, N, k, h, dtype, seed=0) -> tuple[list[Tensor], Tensor]:
    """Mean, covariance, outputs of the measurement network, C, and weights of the means in a loss."""
    g = torch.Generator().manual_seed(seed)

    def normal(*size: int) -> Tensor:
        return torch.randn(M, *size, generator=g, dtype=torch.float64)

    factor = normal(B, h, h)
    covariance = factor @ factor.mT / h + 0.1 * torch.eye(h, dtype=torch.float64)
    outputs, C = normal(B, N, measurement_size(k)), normal(k, h) / math.sqrt(h)
    outputs[..., k::5] *= 10 * LARGEST_FACTOR  # most of them beyond the bound, on both sides
    *arguments, weights = (x.to(dtype) for x in (normal(B, h), covariance, outputs, C, normal(B, N + 1, h)))
    return arguments, weights


def fused(mean: Tensor, covariance: Tensor, outputs: Tensor, C: Tensor) -> Tensor:
    return FusedFilterMeans.apply(mean, covariance, outputs, C, DRIFT)


def plain(mean: Tensor, covariance: Tensor, outputs: Tensor, C: Tensor) -> Tensor:
    return PlainFilterMeans.apply(mean, covariance, *whiten(*unpack(outputs, len(C[0])), C), DRIFT)


def means_and_gradients(filter_means, arguments, weights) -> list[Tensor]:
    inputs = [x.clone().requires_grad_() for x in arguments]
    means = filter_means(*inputs)
    return [means.detach(), *torch.autograd.grad(means, inputs, weights)]


def errors(found: list[Tensor], exact: list[Tensor]) -> list[float]:
    """Largest error of each, of the largest entry."""
    return [((x - y).abs().max() / y.abs().max()).item() for x, y in zip(found, exact, strict=True)]


@pytest.mark.parametrize("sizes", SIZES)
def test_equals_the_plain_filter(sizes):
    arguments, weights = draw(*sizes, torch.float64)
    found, expected = (means_and_gradients(f, arguments, weights) for f in (fused, plain))
    assert arguments[2].abs().max() > LARGEST_FACTOR
    # S has condition numbers up to LARGEST_FACTOR^2 k^2 = 3e6, and float64 rounds by 1e-16.
    assert max(errors(found, expected)) < 1e-9


@pytest.mark.parametrize("sizes", SIZES)
def test_rounds_no_worse_than_the_plain_filter_in_float32(sizes):
    arguments, weights = draw(*sizes, torch.float32)
    exact = means_and_gradients(plain, [x.double() for x in arguments], weights.double())
    found, expected = (errors(means_and_gradients(f, arguments, weights), exact) for f in (fused, plain))
    # Largest errors of two ways of rounding the same sums differ by a factor of some units; a result with
    # hardly any error by luck says no more than the rounding of an input that is multiplied with itself.
    floor = 4 * torch.finfo(torch.float32).eps
    assert all(x < 4 * max(y, floor) for x, y in zip(found, expected, strict=True)), (found, expected)


def test_gradients_are_those_of_differences():
    (mean, covariance, outputs, C), _ = draw(2, 3, 3, 2, 3, torch.float64)
    factor = torch.linalg.cholesky(covariance)  # so that differences leave the covariance symmetric
    outputs = outputs.clamp(-2, 2)
    inputs = [x.requires_grad_() for x in (mean, factor, outputs, C)]
    assert torch.autograd.gradcheck(lambda m, factor, o, C: fused(m, factor @ factor.mT, o, C), inputs)


def test_nothing_measured_leaves_the_prior():
    arguments, weights = draw(2, 3, 0, 4, 4, torch.float32)
    means, l_mean, l_covariance, l_outputs, l_C = means_and_gradients(fused, arguments, weights)
    assert torch.equal(means, arguments[0][:, :, None])
    assert torch.equal(l_mean, weights[:, :, 0])
    assert not l_covariance.any()
    assert not l_C.any()
    assert l_outputs.shape == (2, 3, 0, 14)


def test_what_is_not_finite_shows_and_stays_in_its_task():
    arguments, weights = draw(1, 5, 4, 3, 3, torch.float32)
    clean = means_and_gradients(fused, arguments, weights)
    arguments[2][0, 2, 1] = torch.nan
    found = means_and_gradients(fused, arguments, weights)
    others = [0, 1, 3, 4]
    assert found[0][0, 2, 2:].isnan().all()
    assert found[-1].isnan().any()  # C is all tasks'
    for after, before in zip(found[:-1], clean[:-1], strict=True):
        assert torch.equal(after[:, others], before[:, others])


def test_keeps_no_more_than_the_plain_filter():
    """Bytes that each holds until the backward pass, without what `unpack` and `whiten` keep beside it."""
    arguments, _ = draw(2, WIDTH, 8, 16, 16, torch.float32)
    inputs = [x.requires_grad_() for x in arguments]
    kept = sum(x.nbytes for x in fused(*inputs).grad_fn.saved_tensors)
    graph = plain(*inputs).grad_fn
    assert kept < sum(x.nbytes for x in (*graph.saved_tensors, *(x for step in graph.steps for x in step)))
