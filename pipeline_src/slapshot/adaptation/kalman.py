"""Adaptation by a trainable Kalman filter (section "Method" of the paper).

A measurement network turns a sample (s, a, s~') into a Gaussian measurement z of the task's hidden
parameters phi, a Kalman filter integrates the measurements, a prediction network maps (s, a, mean
of phi) to the outcome. All three are trained together through eq. (loss). The symbols are the
paper's; h is the dimension of phi and k that of z, which are equal in the trained model.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from slapshot.adaptation.fused_filter import filter_means
from slapshot.adaptation.kalman_filter import kalman_step, times
from slapshot.adaptation.layers import StackedMLP
from slapshot.adaptation.measurement import measurement_size, positive_diagonal, unpack, whiten
from slapshot.adaptation.method import AdaptationMethod, Sizes
from slapshot.config.methods import KalmanSettings

_SOFTPLUS_INVERSE_OF_ONE = math.log(math.e - 1)


@dataclass(frozen=True)
class KalmanBelief:
    """Gaussian belief about phi: mean (M, B, h) and covariance (M, B, h, h)."""

    mean: Tensor
    covariance: Tensor


class Kalman(AdaptationMethod[KalmanBelief]):
    """The paper's method: measurement network, Kalman filter, prediction network."""

    Settings = KalmanSettings
    settings: KalmanSettings

    def __init__(self, sizes: Sizes, settings: KalmanSettings, models: int, generator: torch.Generator):
        super().__init__(sizes, settings, models, generator)
        h = settings.latent
        query = sizes.state + sizes.action
        measurement = [query + sizes.outcome, *settings.hidden, measurement_size(h)]
        prediction = [query + h, *settings.hidden, sizes.outcome]
        self.measurement_net = StackedMLP(models, measurement, generator)
        self.prediction_net = StackedMLP(models, prediction, generator)
        # The choice of coordinates of phi is free: at first z measures phi itself, and the prior is N(0, I).
        noise = torch.empty(models, h, h).normal_(0, 0.01, generator=generator)
        self.C = nn.Parameter(torch.eye(h) + noise)
        self.prior_mean = nn.Parameter(torch.zeros(models, h))
        raw = _SOFTPLUS_INVERSE_OF_ONE * torch.eye(h)
        self.prior_factor = nn.Parameter(raw.repeat(models, 1, 1))

    def prior(self, tasks: int) -> KalmanBelief:
        """Learned N(mu_phi^0, Sigma_phi^0), Sigma_phi^0 = L L' with L's diagonal positive."""
        L = positive_diagonal(self.prior_factor)
        mean, covariance = self.prior_mean[:, None], (L @ L.mT)[:, None]
        return KalmanBelief(mean.expand(-1, tasks, -1), covariance.expand(-1, tasks, -1, -1))

    def measure(self, state: Tensor, action: Tensor, observed: Tensor) -> tuple[Tensor, Tensor]:
        """Measurement model mu_z, Sigma_z = f^m(s, a, s~'): returns mu_z and L, Sigma_z^-1 = L L'.

        Full, because one sample fixes some directions of phi and leaves others open, and which ones
        depends on (s, a): a diagonal Sigma_z could only weigh fixed directions, the rows of C. On
        tasks y = W x with W 2 x 2 a diagonal one left 1.5 times the squared error after 15 samples,
        with twice the parameters. L factors the precision, not the covariance, because an unobserved
        direction then has a precision near 0, which is harmless; its large variance would drown the
        small ones in the rounding of float32.

        Inputs are (M, ..., d), results (M, ..., h) and (M, ..., h, h).
        """
        return unpack(self._measurement(state, action, observed), self.settings.latent)

    def _measurement(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        return self.measurement_net(torch.cat([state, action, observed], dim=-1))

    def whiten(self, mean: Tensor, L: Tensor) -> tuple[Tensor, Tensor]:
        """Return y = L' mu_z and H = L' C_z, the whitened measurement for `kalman_step`."""
        return whiten(mean, L, self.C)

    def update(self, belief: KalmanBelief, state: Tensor, action: Tensor, observed: Tensor) -> KalmanBelief:
        """Update the belief with one sample (M, B, d); see `kalman_step`."""
        y, H = self.whiten(*self.measure(state, action, observed))
        return self._integrate(belief, y, H)

    def predict(self, belief: KalmanBelief, state: Tensor, action: Tensor) -> Tensor:
        """Prediction model at the mean of the belief, (M, B, Q, do)."""
        return self.outcome(belief.mean[:, :, None], state, action)

    def outcome(self, phi: Tensor, state: Tensor, action: Tensor) -> Tensor:
        """Prediction model s^' = f^p(s, a, phi), (M, ..., do); the leading dimensions broadcast."""
        inputs = (state, action, phi)
        lead = torch.broadcast_shapes(*(x.shape[:-1] for x in inputs))
        joined = torch.cat([x.expand(*lead, x.shape[-1]) for x in inputs], dim=-1)
        return self.prediction_net(joined)

    def hidden(self, belief: KalmanBelief) -> Tensor:
        """Mean of phi, (M, B, h)."""
        return belief.mean

    def adapt(self, state: Tensor, action: Tensor, observed: Tensor) -> list[KalmanBelief]:
        """Return the beliefs after 0, ..., N samples; the measurement network runs once."""
        beliefs = [self.prior(state.shape[1])]
        y, H = self.whiten(*self.measure(state, action, observed))
        for y_i, H_i in zip(y.unbind(2), H.unbind(2), strict=True):
            beliefs.append(self._integrate(beliefs[-1], y_i, H_i))
        return beliefs

    def sequence_predictions(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        """Predict each outcome from the samples before it; both networks run only once."""
        prior = self.prior(state.shape[1])
        # Prediction i is made from the belief after samples 0, ..., i - 1; the last is never used.
        used = (x[:, :, :-1] for x in (state, action, observed))
        measured = self._measurement(*used)
        means = filter_means(prior.mean, prior.covariance, measured, self.C, self.settings.drift)
        return self.outcome(means, state, action)

    def sample_phi(self, belief: KalmanBelief, samples: int, generator: torch.Generator) -> Tensor:
        """Draw phi ~ N(mu_phi, Sigma_phi), (M, B, samples, h), for predictive intervals."""
        models, tasks, h = belief.mean.shape
        # Drawn on the generator's device: a seed on the CPU gives the same draws on every device.
        white = torch.randn(models, tasks, samples, h, generator=generator, device=generator.device)
        L = torch.linalg.cholesky_ex(belief.covariance).L
        return belief.mean[:, :, None] + white.to(L) @ L.mT

    def normalised_innovation_squared(
        self, belief: KalmanBelief, state: Tensor, action: Tensor, observed: Tensor
    ) -> Tensor:
        """(M, B) normalised innovation squared r' S^-1 r, r = y - H mu, of a sample (M, B, d).

        The usual test of a filter's consistency. It would follow a chi-squared distribution with k
        degrees of freedom if the filter were trained by likelihood; training by squared error does not
        fix the belief's scale, so it must be compared with simulated samples instead.
        """
        y, H = self.whiten(*self.measure(state, action, observed))
        step = kalman_step(belief.mean, belief.covariance, y, H, self.settings.drift)
        innovation = y - times(H, belief.mean)
        return (innovation * step.residual).sum(-1)

    def _integrate(self, belief: KalmanBelief, y: Tensor, H: Tensor) -> KalmanBelief:
        step = kalman_step(belief.mean, belief.covariance, y, H, self.settings.drift)
        return KalmanBelief(step.mean, step.covariance)


METHOD = Kalman
