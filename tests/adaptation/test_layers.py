"""StackedMLP against the M separate networks that it stands for."""

import math

import pytest
import torch
from slapshot.adaptation.layers import StackedMLP
from torch import nn

SIZES = (5, 12, 7, 3)


def separate(stack: StackedMLP, model: int, activation: type[nn.Module]) -> nn.Sequential:
    """The network of one model, from the standard layers, with the same weights."""
    layers: list[nn.Module] = []
    for weight, bias in zip(stack.weights, stack.biases, strict=True):
        linear = nn.Linear(weight.shape[1], weight.shape[2], dtype=weight.dtype)
        with torch.no_grad():
            linear.weight.copy_(weight[model].mT)
            linear.bias.copy_(bias[model, 0])
        layers += [linear, activation()]
    return nn.Sequential(*layers[:-1])


@pytest.mark.parametrize(("name", "module"), [("relu", nn.ReLU), ("silu", nn.SiLU)])
@pytest.mark.parametrize("lead", [(), (4,), (2, 3, 6)])
def test_equals_separate_networks(name, module, lead):
    generator = torch.Generator().manual_seed(0)
    stack = StackedMLP(3, SIZES, generator, activation=name).double()
    x = torch.randn(3, *lead, SIZES[0], generator=generator, dtype=torch.float64)
    y = stack(x)
    assert y.shape == (3, *lead, SIZES[-1])
    for model in range(3):
        expected = separate(stack, model, module)(x[model])
        # Sums of at most 12 products of order 1: float64 rounding stays below 1e-14.
        torch.testing.assert_close(y[model], expected, rtol=0, atol=1e-14)


def test_initial_weights_are_those_of_linear():
    d_in, d_out, models = 9, 400, 5
    stack = StackedMLP(models, (d_in, d_out), torch.Generator().manual_seed(1))
    bound = 1 / math.sqrt(d_in)
    for values in (stack.weights[0], stack.biases[0]):
        n = values.numel()
        assert values.abs().max() <= bound
        # U(-b, b) has variance b^2 / 3; its square has variance 4 b^4 / 45. Six standard errors.
        assert abs(values.square().mean() - bound**2 / 3) < 6 * math.sqrt(4 * bound**4 / 45 / n)
    assert not torch.equal(stack.weights[0][0], stack.weights[0][1])


def test_weights_depend_on_the_generator_only():
    def weights(seed: int) -> list[torch.Tensor]:
        stack = StackedMLP(2, SIZES, torch.Generator().manual_seed(seed))
        return [p.detach() for p in stack.parameters()]

    before = torch.get_rng_state()
    first = weights(3)
    assert torch.equal(before, torch.get_rng_state())
    torch.rand(7)
    assert all(torch.equal(a, b) for a, b in zip(first, weights(3), strict=True))
    assert not any(torch.equal(a, b) for a, b in zip(first, weights(4), strict=True))


def test_needs_an_output():
    with pytest.raises(ValueError, match="output width"):
        StackedMLP(1, (4,), torch.Generator())
