"""The compiled filter against the plain one, in values and gradients, on the sizes that lanes may spoil."""

import pytest
import torch
from slapshot.adaptation.fused_filter import FusedFilterMeans
from slapshot.adaptation.kalman_filter import PlainFilterMeans
from slapshot.adaptation.lanes import WIDTH
from torch import Tensor

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
    """Mean, covariance, y, H, and weights of the means in a loss."""
    g = torch.Generator().manual_seed(seed)

    def normal(*size: int) -> Tensor:
        return torch.randn(M, B, *size, generator=g, dtype=torch.float64)

    factor = normal(h, h)
    covariance = factor @ factor.mT / h + 0.1 * torch.eye(h, dtype=torch.float64)
    given = [normal(h), covariance, normal(N, k), normal(N, k, h), normal(N + 1, h)]
    *arguments, weights = (x.to(dtype) for x in given)
    return arguments, weights


def means_and_gradients(function, arguments, weights, drift=0.01) -> list[Tensor]:
    inputs = [x.clone().requires_grad_() for x in arguments]
    means = function.apply(*inputs, drift)
    return [means.detach(), *torch.autograd.grad(means, inputs, weights)]


def errors(found: list[Tensor], exact: list[Tensor]) -> list[float]:
    """Largest error of each, of the largest entry."""
    return [((x - y).abs().max() / y.abs().max()).item() for x, y in zip(found, exact, strict=True)]


@pytest.mark.parametrize("sizes", SIZES)
def test_equals_the_plain_filter(sizes):
    arguments, weights = draw(*sizes, torch.float64)
    fused, plain = (
        means_and_gradients(function, arguments, weights) for function in (FusedFilterMeans, PlainFilterMeans)
    )
    # S has condition numbers below 1e3, and sums have some h k = 1e2 terms, N times: 1e5 of 1e-16.
    assert max(errors(fused, plain)) < 1e-11


@pytest.mark.parametrize("sizes", SIZES)
def test_rounds_no_worse_than_the_plain_filter_in_float32(sizes):
    arguments, weights = draw(*sizes, torch.float32)
    exact = means_and_gradients(PlainFilterMeans, [x.double() for x in arguments], weights.double())
    fused, plain = (
        errors(means_and_gradients(function, arguments, weights), exact)
        for function in (FusedFilterMeans, PlainFilterMeans)
    )
    # Largest errors of two ways of rounding the same sums differ by a factor of some units; a result with
    # hardly any error by luck says no more than the rounding of an input that is multiplied with itself.
    assert all(x < 4 * max(y, 4 * torch.finfo(torch.float32).eps) for x, y in zip(fused, plain, strict=True))


def test_gradients_are_those_of_differences():
    arguments, _ = draw(2, 3, 3, 2, 3, torch.float64)
    inputs = [x.requires_grad_() for x in arguments]

    def means(mean: Tensor, factor: Tensor, y: Tensor, H: Tensor) -> Tensor:
        return FusedFilterMeans.apply(mean, factor @ factor.mT, y, H, 0.1)  # symmetric under a difference

    assert torch.autograd.gradcheck(means, inputs)


def test_nothing_measured_leaves_the_prior():
    arguments, weights = draw(2, 3, 0, 4, 4, torch.float32)
    means, l_mean, l_covariance, l_y, l_H = means_and_gradients(FusedFilterMeans, arguments, weights)
    assert torch.equal(means, arguments[0][:, :, None])
    assert torch.equal(l_mean, weights[:, :, 0])
    assert not l_covariance.any()
    assert (l_y.shape, l_H.shape) == ((2, 3, 0, 4), (2, 3, 0, 4, 4))


def test_what_is_not_finite_shows_and_stays_in_its_task():
    arguments, weights = draw(1, 5, 4, 3, 3, torch.float32)
    clean = means_and_gradients(FusedFilterMeans, arguments, weights)
    arguments[2][0, 2, 1] = torch.nan
    means, *gradients = means_and_gradients(FusedFilterMeans, arguments, weights)
    others = [0, 1, 3, 4]
    assert means[0, 2, 2:].isnan().all()
    for found, before in zip((means, *gradients), clean, strict=True):
        assert torch.equal(found[:, others], before[:, others])


def test_saves_no_more_than_the_plain_filter():
    """Bytes that the graph holds until the backward pass."""
    arguments, _ = draw(2, WIDTH, 8, 16, 16, torch.float32)
    inputs = [x.requires_grad_() for x in arguments]
    fused = FusedFilterMeans.apply(*inputs, 0.01).grad_fn
    plain = PlainFilterMeans.apply(*inputs, 0.01).grad_fn
    saved = sum(x.nbytes for x in fused.saved_tensors)
    assert saved < sum(x.nbytes for x in (*plain.saved_tensors, *(x for step in plain.steps for x in step)))
