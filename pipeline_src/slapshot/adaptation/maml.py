"""Adaptation by gradient descent: model-based MAML (Finn et al. 2017), the paper's other baseline.

A network f_theta(s, a) -> s' is adapted by steps of gradient descent on batches of k samples, from a
learned theta_0 and with a learned step size alpha:

    theta_t+1 = theta_t - alpha grad_theta 1 / (k do) sum_batch |f_theta(s, a) - s~'|^2

Every task has its own theta_t, but none is ever formed. A layer z = x W + b with error delta = dE/dz
of a sample has dE/dW = x' delta and dE/db = delta (row vectors). So after steps on n samples

    W_t = W_0 - alpha sum_j x_j' delta_j,   b_t = b_0 - alpha sum_j delta_j,   j = 1, ..., n

and with the rows X_j = x_j and D_j = -alpha delta_j, the layer's input and displacement at sample j,

    x W_t + b_t = x W_0 + b_0 + (x X' + 1) D
    delta W_t'  = delta W_0' + (delta D') X

which is all that a forward and a backward pass need. |grad|^2 of a task, which is bounded, follows in the
same way: it is the sum over layers and pairs of samples of (x_i x_j' + 1) (delta_i delta_j').

The backward pass of a step is written out in plain tensor operations, so that autograd can differentiate
it once more: training uses the full, second-order gradient.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from slapshot.adaptation.layers import StackedMLP
from slapshot.adaptation.method import AdaptationMethod, Sizes
from slapshot.config.methods import MamlSettings

LARGEST_GRADIENT = 10.0
"""Bound on the norm of a task's inner gradient, the only addition to the published method.

Steps on one sample overshoot where the input is large, the next ones do so more, and what training
may only do three times an evaluation repeats: without a bound, training on random linear tasks had
losses of 1e7, and ten to twenty steps on single samples ended in nan. With it a step cannot be
longer than 10 alpha. It takes hold of some 5 % of the steps on single samples, of fewer than 1 % of
those on 4 or 8.
"""


@dataclass(frozen=True)
class MamlBelief:
    """Difference of theta_t from theta_0 after steps on n samples, and the samples not used yet.

    Attributes:
        inputs: X of every layer, (M, B, n, d_in).
        moves: D of every layer, (M, B, n, d_out).
        waiting: (s, a, s~') of an incomplete batch, (M, B, fewer than k, ds + da + do).
    """

    inputs: tuple[Tensor, ...]
    moves: tuple[Tensor, ...]
    waiting: Tensor


class ForwardPass(NamedTuple):
    """Input x of every layer, (M, B, Q, d_in), and its output z before the activation."""

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]


class Maml(AdaptationMethod[MamlBelief]):
    """M independent networks, each adapted to every task by its own gradient steps."""

    Settings = MamlSettings
    settings: MamlSettings

    def __init__(self, sizes: Sizes, settings: MamlSettings, models: int, generator: torch.Generator):
        super().__init__(sizes, settings, models, generator)
        self.widths = [sizes.state + sizes.action, *settings.hidden, sizes.outcome]
        self.network = StackedMLP(models, self.widths, generator)  # theta_0
        # The logarithm keeps alpha positive.
        self.log_step_size = nn.Parameter(torch.full((models,), math.log(settings.step_size)))

    def prior(self, tasks: int) -> MamlBelief:
        """Belief before any step: theta_0, no sample waiting."""

        def empty(width: int) -> Tensor:
            return self.log_step_size.new_empty(self.models, tasks, 0, width)

        return MamlBelief(
            inputs=tuple(empty(width) for width in self.widths[:-1]),
            moves=tuple(empty(width) for width in self.widths[1:]),
            waiting=empty(self.widths[0] + self.sizes.outcome),
        )

    def update(self, belief: MamlBelief, state: Tensor, action: Tensor, observed: Tensor) -> MamlBelief:
        """Add one sample per task, each (M, B, d), and make a step if it completes a batch."""
        seen = belief.moves[0].shape[2] + belief.waiting.shape[2]
        if self._used(seen + 1) == seen:
            return belief
        sample = torch.cat([state, action, observed], dim=-1)[:, :, None]
        waiting = torch.cat([belief.waiting, sample], dim=2)
        if waiting.shape[2] < self.settings.batch:
            return replace(belief, waiting=waiting)
        query, observed = waiting.split([self.widths[0], self.sizes.outcome], dim=-1)
        return self._descend(belief, self._forward(belief, query), observed)

    def predict(self, belief: MamlBelief, state: Tensor, action: Tensor) -> Tensor:
        """Adapted network f_theta_t(s, a), (M, B, Q, do)."""
        return self._forward(belief, torch.cat([state, action], dim=-1)).outputs[-1]

    def hidden(self, belief: MamlBelief) -> Tensor:
        """Displacement b_t - b_0 of the biases of all layers, (M, B, sum of their widths).

        A part of theta_t - theta_0 small enough for a latent analysis: the sum of the rows of D, 0 before
        any step.
        """
        return torch.cat([D.sum(2) for D in belief.moves], dim=-1)

    def adapt(self, state: Tensor, action: Tensor, observed: Tensor) -> list[MamlBelief]:
        """Return the beliefs after 0, ..., N samples, all of them views of the last one's tensors.

        Views suffice because samples are only appended. Separate tensors would take N / 2 times the memory.
        """
        k = self.settings.batch
        query = torch.cat([state, action], dim=-1)
        samples = torch.cat([query, observed], dim=-1)
        last = self.prior(state.shape[1])
        for start in range(0, self._used(state.shape[2]) - k + 1, k):
            batch = slice(start, start + k)
            last = self._descend(last, self._forward(last, query[:, :, batch]), observed[:, :, batch])
        beliefs = []
        for i in range(state.shape[2] + 1):
            used = self._used(i)
            n = used - used % k
            inputs = tuple(X[:, :, :n] for X in last.inputs)
            moves = tuple(D[:, :, :n] for D in last.moves)
            beliefs.append(MamlBelief(inputs, moves, waiting=samples[:, :, n:used]))
        return beliefs

    def sequence_predictions(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        """Predict each outcome from the complete batches before it; those with the same theta_t at once.

        The predictions of a batch's own outcomes are the forward pass of the step on that batch.
        """
        k, N = self.settings.batch, state.shape[2]
        query = torch.cat([state, action], dim=-1)
        belief, predictions = self.prior(state.shape[1]), []
        # The last observation is never adapted to: no prediction follows it.
        steps = self._used(N - 1) // k
        for start in range(0, steps * k, k):
            batch = slice(start, start + k)
            forward = self._forward(belief, query[:, :, batch])
            predictions.append(forward.outputs[-1])
            belief = self._descend(belief, forward, observed[:, :, batch])
        predictions.append(self._forward(belief, query[:, :, steps * k :]).outputs[-1])
        return torch.cat(predictions, dim=2)

    def _used(self, samples: int) -> int:
        """Return how many of a sequence's first samples adapt theta: training makes at most `steps` steps."""
        limit = self.settings.steps * self.settings.batch
        return min(samples, limit) if self.training else samples

    def _forward(self, belief: MamlBelief, x: Tensor) -> ForwardPass:
        """Adapted network at x (M, B, Q, ds + da), by z = x W_0 + b_0 + (x X' + 1) D."""
        inputs: list[Tensor] = []
        outputs: list[Tensor] = []
        layers = zip(self.network.weights, self.network.biases, belief.inputs, belief.moves, strict=True)
        for W, b, X, D in layers:
            inputs.append(functional.silu(outputs[-1]) if outputs else x)
            outputs.append(_layer(inputs[-1], W, b) + (inputs[-1] @ X.mT + 1) @ D)
        return ForwardPass(tuple(inputs), tuple(outputs))

    def _descend(self, belief: MamlBelief, forward: ForwardPass, observed: Tensor) -> MamlBelief:
        """Make one step from theta_t, given its forward pass on the batch, observed (M, B, k, do).

        delta_L = 2 / (k do) (f_theta_t(s, a) - s~'),   delta_l-1 = h'(z_l-1) (delta_l W_l,t')

        with h' taken elementwise, and the step shortened where its gradient exceeds the bound.
        """
        error = forward.outputs[-1] - observed
        deltas = [2 / error[0, 0].numel() * error]
        layers = zip(self.network.weights, belief.inputs, belief.moves, strict=True)
        for (W, X, D), z in zip(reversed([*layers][1:]), reversed(forward.outputs[:-1]), strict=True):
            back = _times(deltas[0], W.mT) + (deltas[0] @ D.mT) @ X
            deltas.insert(0, _silu_slope(z) * back)
        squared_norms = [
            ((x @ x.mT + 1) * (delta @ delta.mT)).sum(dim=(2, 3))
            for x, delta in zip(forward.inputs, deltas, strict=True)
        ]
        norm = torch.stack(squared_norms).sum(0).clamp_min(LARGEST_GRADIENT**2).sqrt()
        alpha = (self.log_step_size.exp()[:, None] * LARGEST_GRADIENT / norm)[..., None, None]
        inputs = zip(belief.inputs, forward.inputs, strict=True)
        moves = zip(belief.moves, deltas, strict=True)
        return MamlBelief(
            inputs=tuple(torch.cat([X, x], dim=2) for X, x in inputs),
            moves=tuple(torch.cat([D, -alpha * delta], dim=2) for D, delta in moves),
            waiting=belief.waiting[:, :, :0],
        )


def _layer(x: Tensor, W: Tensor, b: Tensor) -> Tensor:
    """X W + b for x (M, B, Q, d_in), weights (M, d_in, d_out) and biases (M, 1, d_out)."""
    return torch.baddbmm(b, x.flatten(1, 2), W).unflatten(1, x.shape[1:3])


def _times(x: Tensor, W: Tensor) -> Tensor:
    """X W for x (M, B, Q, d_in) and the weights (M, d_in, d_out) that all tasks of a model share."""
    return torch.bmm(x.flatten(1, 2), W).unflatten(1, x.shape[1:3])


def _silu_slope(z: Tensor) -> Tensor:
    """h'(z) of h(z) = z sigmoid(z), in operations that autograd can differentiate."""
    s = z.sigmoid()
    return s * (1 + z * (1 - s))


METHOD = Maml
