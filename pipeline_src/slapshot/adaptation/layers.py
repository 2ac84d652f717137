"""Layers that hold M independent networks and evaluate all of them with one call per layer."""

import itertools
import math
from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

Activation = Literal["relu", "silu"]

_ACTIVATIONS = {"relu": functional.relu, "silu": functional.silu}


class StackedMLP(nn.Module):
    """M independent multilayer perceptrons: y_m = W_L,m h(... h(W_1,m x_m + b_1,m) ...) + b_L,m.

    The hidden layers have the activation h, the last layer has none. Model m sees only slice m of
    the input, so the gradients of the models never mix. Weights are kept as (M, d_in, d_out), the
    transpose of `torch.nn.Linear`, because that is the order in which bmm multiplies.
    """

    def __init__(
        self,
        models: int,
        sizes: Sequence[int],
        generator: torch.Generator,
        activation: Activation = "silu",
    ):
        """Draw the weights of all models.

        Args:
            models: M, the number of independent networks.
            sizes: widths (d_in, hidden ..., d_out).
            generator: source of the initial weights; no global random state is touched.
            activation: of the hidden layers. SiLU is smooth, which matters where a prediction is
                differentiated with respect to its action.
        """
        super().__init__()
        if len(sizes) < 2:
            raise ValueError(f"an MLP needs an input and an output width, got sizes {tuple(sizes)}")
        self.activation = _ACTIVATIONS[activation]
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for d_in, d_out in itertools.pairwise(sizes):
            # torch.nn.Linear draws weight and bias from U(-b, b) with b = 1 / sqrt(d_in).
            bound = 1 / math.sqrt(d_in)
            weight = torch.empty(models, d_in, d_out).uniform_(-bound, bound, generator=generator)
            bias = torch.empty(models, 1, d_out).uniform_(-bound, bound, generator=generator)
            self.weights.append(nn.Parameter(weight))
            self.biases.append(nn.Parameter(bias))

    def forward(self, x: Tensor) -> Tensor:
        """Map x of shape (M, ..., d_in) to (M, ..., d_out)."""
        lead = x.shape[:-1]
        y = x.reshape(lead[0], -1, x.shape[-1])
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if layer:
                y = self.activation(y)
            y = torch.baddbmm(bias, y, weight)
        return y.reshape(*lead, y.shape[-1])
