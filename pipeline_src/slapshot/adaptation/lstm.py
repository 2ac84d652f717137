"""Black-box recurrent adaptation: the paper's LSTM baseline (section "Results", after Hochreiter 2001).

An LSTM cell reads the samples (s, a, s~') one after the other, and a prediction network maps (s, a, h)
to the outcome. It has no model of noise or of parameters: how to weigh a sample against what is
already known is learned through eq. (loss), like everything else.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from slapshot.adaptation.layers import StackedMLP
from slapshot.adaptation.method import AdaptationMethod, Sizes
from slapshot.config.methods import LstmSettings


@dataclass(frozen=True)
class LstmBelief:
    """State of the LSTM: its output h and its cell c, both (M, B, H)."""

    h: Tensor
    c: Tensor


def lstm_step(belief: LstmBelief, projected: Tensor, recurrent: Tensor) -> LstmBelief:
    """Update the cell with one sample.

        (i, f, g, o) = W x + b + U h
        c <- sigmoid(f) c + sigmoid(i) tanh(g)
        h <- sigmoid(o) tanh(c)

    Args:
        belief: h and c before the step.
        projected: W x + b, (M, B, 4 H), gates in the order of `torch.nn.LSTM`: i, f, g, o.
        recurrent: U in the layout of bmm, (M, H, 4 H).
    """
    i, f, g, o = torch.baddbmm(projected, belief.h, recurrent).chunk(4, dim=-1)
    c = f.sigmoid() * belief.c + i.sigmoid() * g.tanh()
    return LstmBelief(o.sigmoid() * c.tanh(), c)


class Lstm(AdaptationMethod[LstmBelief]):
    """M independent LSTMs, each with a prediction network."""

    Settings = LstmSettings
    settings: LstmSettings

    def __init__(self, sizes: Sizes, settings: LstmSettings, models: int, generator: torch.Generator):
        super().__init__(sizes, settings, models, generator)
        H = settings.state
        query = sizes.state + sizes.action
        # torch.nn.LSTM draws everything from U(-b, b) with b = 1 / sqrt(H). Its two biases only occur
        # as a sum, so here there is one.
        bound = 1 / math.sqrt(H)

        def uniform(*shape: int) -> Tensor:
            return torch.empty(models, *shape).uniform_(-bound, bound, generator=generator)

        self.input_weight = nn.Parameter(uniform(query + sizes.outcome, 4 * H))
        self.recurrent_weight = nn.Parameter(uniform(H, 4 * H))
        bias = uniform(1, 4 * H)
        # A forget gate of sigmoid(1) = 0.73 keeps most of c from one sample to the next. A bias of 0 would
        # halve it, and a gradient over 32 samples would shrink by 2^-32: old samples could not be learned.
        bias[..., H : 2 * H] = 1.0
        self.bias = nn.Parameter(bias)
        # The initial state is learned, like the prior of the Kalman method.
        self.prior_h = nn.Parameter(torch.zeros(models, H))
        self.prior_c = nn.Parameter(torch.zeros(models, H))
        self.prediction_net = StackedMLP(models, [query + H, *settings.hidden, sizes.outcome], generator)

    def prior(self, tasks: int) -> LstmBelief:
        """Learned initial h and c, the same for all tasks."""
        h, c = (x[:, None].expand(-1, tasks, -1) for x in (self.prior_h, self.prior_c))
        return LstmBelief(h, c)

    def update(self, belief: LstmBelief, state: Tensor, action: Tensor, observed: Tensor) -> LstmBelief:
        """Update the cell with one sample per task, each (M, B, d)."""
        return lstm_step(belief, self._project(state, action, observed), self.recurrent_weight)

    def predict(self, belief: LstmBelief, state: Tensor, action: Tensor) -> Tensor:
        """Prediction network at h, (M, B, Q, do)."""
        h = belief.h[:, :, None].expand(-1, -1, state.shape[2], -1)
        return self.prediction_net(torch.cat([state, action, h], dim=-1))

    def hidden(self, belief: LstmBelief) -> Tensor:
        """Output h of the LSTM, (M, B, H), the only part of the belief that a prediction uses."""
        return belief.h

    def adapt(self, state: Tensor, action: Tensor, observed: Tensor) -> list[LstmBelief]:
        """Return the beliefs after 0, ..., N samples; W x + b is computed for all samples at once."""
        beliefs = [self.prior(state.shape[1])]
        for projected in self._project(state, action, observed).unbind(2):
            beliefs.append(lstm_step(beliefs[-1], projected, self.recurrent_weight))
        return beliefs

    def sequence_predictions(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        """Predict each outcome from the samples before it; the prediction network runs only once."""
        # Prediction i is made from the belief after samples 0, ..., i - 1; the last is never used.
        beliefs = self.adapt(*(x[:, :, :-1] for x in (state, action, observed)))
        h = torch.stack([belief.h for belief in beliefs], dim=2)
        return self.prediction_net(torch.cat([state, action, h], dim=-1))

    def _project(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        """W x + b of x = (s, a, s~'), (M, ..., 4 H)."""
        x = torch.cat([state, action, observed], dim=-1)
        projected = torch.baddbmm(self.bias, x.flatten(1, -2), self.input_weight)
        return projected.unflatten(1, x.shape[1:-1])


METHOD = Lstm
