"""Adaptation by a trainable Kalman filter (section "Method" of the paper).

A measurement network turns a sample (s, a, s~') into a Gaussian measurement z of the task's hidden
parameters phi, a Kalman filter integrates the measurements, a prediction network maps (s, a, mean
of phi) to the outcome. All three are trained together through eq. (loss). The symbols are the
paper's; h is the dimension of phi and k that of z, which are equal in the trained model.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional

from slapshot.adaptation.layers import StackedMLP
from slapshot.adaptation.method import AdaptationMethod, Sizes
from slapshot.config.methods import KalmanSettings

LARGEST_FACTOR = 100.0
"""Bound on the entries of L in Sigma_z^-1 = L L'. The prior's variance starts at 1 in the same
coordinates, so one sample can shrink a standard deviation about a hundredfold. Without a bound, P
could come to span more than the seven digits of float32."""

_SOFTPLUS_INVERSE_OF_ONE = math.log(math.e - 1)


@dataclass(frozen=True)
class KalmanBelief:
    """Gaussian belief about phi: mean (M, B, h) and covariance (M, B, h, h)."""

    mean: Tensor
    covariance: Tensor


class FilterStep(NamedTuple):
    """Result of one filter step and what its adjoint needs."""

    mean: Tensor  # mu_phi^{t+1|t+1}, (M, B, h)
    covariance: Tensor  # Sigma_phi^{t+1|t+1}, (M, B, h, h)
    gain: Tensor  # K, (M, B, h, k)
    shrinkage: Tensor  # I - K H, (M, B, h, h)
    residual: Tensor  # r = S^-1 (y - H mu), (M, B, k)


def kalman_step(mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor, drift: float) -> FilterStep:
    """Let the parameters drift once and integrate one whitened measurement.

    A measurement z ~ N(C phi, Sigma_z) with Sigma_z^-1 = L L' is the same as y ~ N(H phi, I) with
    y = L' z and H = L' C. Eqs. (pred_mean, pred_cov) with A = I, B = 0, Q = drift I, then eqs.
    (kalmangain, mu_update) are

        P  = Sigma_phi + drift I
        S  = H P H' + I,   K = P H' S^-1
        mu = mu + K (y - H mu)

    with K the paper's gain times L'^-1. Eq. (sigma_update) is taken in the form of Joseph,

        Sigma_phi = (I - K H) P (I - K H)' + K K'

    Equal to (I - K H) P for the exact gain, but a sum of two positive semidefinite terms whose
    error is of second order in that of K. The short form is a difference, which float32 makes
    indefinite once a precise measurement has taken most of the variance.

    Args:
        mean: mu_phi before the step, (M, B, h).
        covariance: Sigma_phi before the step, (M, B, h, h).
        y: whitened measurement L' mu_z, (M, B, k).
        H: whitened measurement matrix L' C_z, (M, B, k, h).
        drift: epsilon of Q = epsilon I.
    """
    identity = torch.eye(mean.shape[-1], dtype=mean.dtype, device=mean.device)
    P = covariance + drift * identity
    PH = P @ H.mT
    S = H @ PH + torch.eye(y.shape[-1], dtype=mean.dtype, device=mean.device)
    # No eigenvalue of S is below 1, so only inputs that are not finite could fail here, and they
    # show in the result: the _ex variant leaves out a check on every step.
    S_inverse = torch.cholesky_inverse(torch.linalg.cholesky_ex(S).L)
    gain = PH @ S_inverse
    innovation = y - _times(H, mean)
    shrinkage = identity - gain @ H
    joseph = shrinkage @ P @ shrinkage.mT + gain @ gain.mT
    return FilterStep(
        mean=mean + _times(gain, innovation),
        covariance=0.5 * (joseph + joseph.mT),
        gain=gain,
        shrinkage=shrinkage,
        residual=_times(S_inverse, innovation),
    )


def filter_means(mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor, drift: float) -> Tensor:
    """Means of phi after 0, 1, ..., N measurements, (M, B, N + 1, h): `kalman_step` in a loop.

    Arguments as in `kalman_step`, with y (M, B, N, k) and H (M, B, N, k, h). The gradient is a
    hand-written adjoint of matrix products only, faster than differentiating the loop.
    """
    return _FilterMeans.apply(mean, covariance, y, H, drift)


class _FilterMeans(torch.autograd.Function):
    """Filter recursion with its adjoint."""

    @staticmethod
    def forward(ctx: Any, mean: Tensor, covariance: Tensor, y: Tensor, H: Tensor, drift: float) -> Tensor:
        ctx.save_for_backward(H)
        ctx.steps = []
        means = [mean]
        for y_i, H_i in zip(y.unbind(2), H.unbind(2), strict=True):
            step = kalman_step(mean, covariance, y_i, H_i, drift)
            mean, covariance = step.mean, step.covariance
            means.append(mean)
            ctx.steps.append(step)
        return torch.stack(means, dim=2)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Adjoint of the recursion, backwards in time.

        With l = dL/dmu and G = dL/dSigma_phi (symmetric) after a step, k = K' l, a = (I - K H)' l
        and Sigma, mu the step's results, differentiating eqs. (kalmangain) to (sigma_update) gives

            dL/dy = k
            dL/dH = r (Sigma l)' - k mu' - 2 K' G Sigma
            l    <- a + dL/dmu of the step before
            G    <- (I - K H)' G (I - K H) + sym(a (H' r)')
        """
        (H,) = ctx.saved_tensors
        per_step = gradients[0]
        l_mean = per_step[:, :, -1]
        l_cov = l_mean.new_zeros(*l_mean.shape, l_mean.shape[-1])
        l_y, l_H = H.new_empty(H.shape[:-1]), torch.empty_like(H)
        for i in reversed(range(len(ctx.steps))):
            step = ctx.steps[i]
            k, a = _times(step.gain.mT, l_mean), _times(step.shrinkage.mT, l_mean)
            l_y[:, :, i] = k
            l_H[:, :, i] = (
                _outer(step.residual, _times(step.covariance, l_mean))
                - _outer(k, step.mean)
                - 2 * step.gain.mT @ l_cov @ step.covariance
            )
            from_gain = _outer(a, _times(H[:, :, i].mT, step.residual))
            l_cov = step.shrinkage.mT @ l_cov @ step.shrinkage + 0.5 * (from_gain + from_gain.mT)
            l_mean = a + per_step[:, :, i]
        return l_mean, l_cov, l_y, l_H, None


def _positive_diagonal(raw: Tensor) -> Tensor:
    """Lower triangle of raw (..., h, h) with its diagonal made positive by softplus."""
    below = torch.ones(raw.shape[-2:], dtype=raw.dtype, device=raw.device).tril(-1)
    return raw * below + torch.diag_embed(functional.softplus(raw.diagonal(dim1=-2, dim2=-1)))


def _times(X: Tensor, v: Tensor) -> Tensor:
    """X v for X (..., r, c) and v (..., c)."""
    return (X @ v[..., None])[..., 0]


def _outer(u: Tensor, v: Tensor) -> Tensor:
    """U v' for u (..., r) and v (..., c)."""
    return u[..., :, None] * v[..., None, :]


class Kalman(AdaptationMethod[KalmanBelief]):
    """The paper's method: measurement network, Kalman filter, prediction network."""

    Settings = KalmanSettings
    settings: KalmanSettings

    def __init__(self, sizes: Sizes, settings: KalmanSettings, models: int, generator: torch.Generator):
        super().__init__(sizes, settings, models, generator)
        h = settings.latent
        query = sizes.state + sizes.action
        measured = h + h * (h + 1) // 2  # mu_z and the lower triangle of Sigma_z's factor
        measurement = [query + sizes.outcome, *settings.hidden, measured]
        prediction = [query + h, *settings.hidden, sizes.outcome]
        self.measurement_net = StackedMLP(models, measurement, generator)
        self.prediction_net = StackedMLP(models, prediction, generator)
        # The coordinates of phi are free: at first z measures phi itself, and the prior is N(0, I).
        noise = torch.empty(models, h, h).normal_(0, 0.01, generator=generator)
        self.C = nn.Parameter(torch.eye(h) + noise)
        self.prior_mean = nn.Parameter(torch.zeros(models, h))
        raw = _SOFTPLUS_INVERSE_OF_ONE * torch.eye(h)
        self.prior_factor = nn.Parameter(raw.repeat(models, 1, 1))

    def prior(self, tasks: int) -> KalmanBelief:
        """Learned N(mu_phi^0, Sigma_phi^0), Sigma_phi^0 = L L' with L's diagonal positive."""
        L = _positive_diagonal(self.prior_factor)
        mean, covariance = self.prior_mean[:, None], (L @ L.mT)[:, None]
        return KalmanBelief(mean.expand(-1, tasks, -1), covariance.expand(-1, tasks, -1, -1))

    def measure(self, state: Tensor, action: Tensor, observed: Tensor) -> tuple[Tensor, Tensor]:
        """Measurement model mu_z, Sigma_z = f^m(s, a, s~'): returns mu_z and L, Sigma_z^-1 = L L'.

        Full, because one sample fixes some directions of phi and leaves others open, and which ones
        depends on (s, a): a diagonal Sigma_z could only weigh fixed directions, the rows of C. On
        tasks y = W x with W 2 x 2 it left 1.5 times the squared error after 15 samples with twice
        the parameters. The factor is that of the inverse, because an open direction is one of
        little precision, a harmless number near 0: the large variance that says the same would
        drown the small ones in the rounding of float32.

        Inputs are (M, ..., d), results (M, ..., h) and (M, ..., h, h).
        """
        out = self.measurement_net(torch.cat([state, action, observed], dim=-1))
        h = self.settings.latent
        mean, packed = out.split([h, out.shape[-1] - h], dim=-1)
        packed = packed.clamp(-LARGEST_FACTOR, LARGEST_FACTOR)
        # Every packed value appears once on or below the diagonal of this square; indexing with
        # tril_indices would do the same with a slower gradient.
        square = torch.cat([packed[..., h:], packed.flip(-1)], dim=-1).unflatten(-1, (h, h))
        return mean, _positive_diagonal(square)

    def whiten(self, mean: Tensor, L: Tensor) -> tuple[Tensor, Tensor]:
        """Return y = L' mu_z and H = L' C_z, the measurement as `kalman_step` takes it."""
        # One product per model rather than one per sample.
        H = (L.mT.reshape(self.models, -1, L.shape[-1]) @ self.C).view(L.shape)
        return _times(L.mT, mean), H

    def update(self, belief: KalmanBelief, state: Tensor, action: Tensor, observed: Tensor) -> KalmanBelief:
        """Measure one sample (M, B, d) and integrate it; see `kalman_step`."""
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
        y, H = self.whiten(*self.measure(*used))
        means = filter_means(prior.mean, prior.covariance, y, H, self.settings.drift)
        return self.outcome(means, state, action)

    def sample_phi(self, belief: KalmanBelief, samples: int, generator: torch.Generator) -> Tensor:
        """Draw phi ~ N(mu_phi, Sigma_phi), (M, B, samples, h), for predictive intervals."""
        models, tasks, h = belief.mean.shape
        # Drawn where the generator lives: a seed on the CPU means the same on every device.
        white = torch.randn(models, tasks, samples, h, generator=generator, device=generator.device)
        L = torch.linalg.cholesky_ex(belief.covariance).L
        return belief.mean[:, :, None] + white.to(L) @ L.mT

    def normalised_innovation_squared(
        self, belief: KalmanBelief, state: Tensor, action: Tensor, observed: Tensor
    ) -> Tensor:
        """(M, B) of r' S^-1 r, r = y - H mu: how far a sample (M, B, d) is from what the belief expects.

        The usual test of a filter's consistency. It would follow a chi-squared distribution with k
        degrees of freedom if the belief's scale were that of a likelihood; trained by squared error it
        must be compared with simulated samples instead.
        """
        y, H = self.whiten(*self.measure(state, action, observed))
        step = kalman_step(belief.mean, belief.covariance, y, H, self.settings.drift)
        innovation = y - _times(H, belief.mean)
        return (innovation * step.residual).sum(-1)

    def _integrate(self, belief: KalmanBelief, y: Tensor, H: Tensor) -> KalmanBelief:
        step = kalman_step(belief.mean, belief.covariance, y, H, self.settings.drift)
        return KalmanBelief(step.mean, step.covariance)


METHOD = Kalman
