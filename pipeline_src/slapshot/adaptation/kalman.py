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
from slapshot.errors import InputError

VARIANCE_FLOOR = 1e-4
"""Smallest eigenvalue of Sigma_z. The prior's variance starts at 1 in the same coordinates, so one
sample can still shrink a standard deviation a hundredfold, and S is well conditioned in float32."""

_SOFTPLUS_INVERSE_OF_ONE = math.log(math.e - 1)


@dataclass(frozen=True)
class KalmanSettings:
    """Settings of the Kalman method.

    Attributes:
        latent: dimension of phi and of z; the paper has 16.
        hidden: widths of the hidden layers, the same in the measurement and prediction networks.
        drift: epsilon of Q = epsilon I, variance gained per sample (the prior's starts at 1).
    """

    latent: int
    hidden: tuple[int, ...]
    drift: float

    def __post_init__(self) -> None:
        if self.latent < 1 or any(width < 1 for width in self.hidden) or self.drift < 0:
            raise InputError(f"Kalman: widths must be at least 1, drift at least 0, got {self}")


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
    shrinkage: Tensor  # I - K C, (M, B, h, h)
    residual: Tensor  # y = S^-1 (z - C mu), (M, B, k)


def kalman_step(
    mean: Tensor, covariance: Tensor, z: Tensor, noise: Tensor, C: Tensor, drift: float
) -> FilterStep:
    """Let the parameters drift once and integrate one measurement.

    Eqs. (pred_mean, pred_cov) with A = I, B = 0, Q = drift I, then eqs. (kalmangain, mu_update):

        P  = Sigma_phi + drift I
        S  = C P C' + Sigma_z,   K = P C' S^-1
        mu = mu + K (z - C mu)

    and eq. (sigma_update) in the form of Joseph,

        Sigma_phi = (I - K C) P (I - K C)' + K Sigma_z K'

    Equal to (I - K C) P for the exact gain, but a sum of two positive semidefinite terms whose
    error is of second order in that of K. The short form is a difference, which float32 makes
    indefinite once a precise measurement has taken most of the variance.

    Args:
        mean: mu_phi before the step, (M, B, h).
        covariance: Sigma_phi before the step, (M, B, h, h).
        z: measurement mean mu_z, (M, B, k).
        noise: covariance Sigma_z of the measurement, (M, B, k, k).
        C: measurement matrix C_z of each model, (M, k, h).
        drift: epsilon of Q = epsilon I.
    """
    identity = torch.eye(mean.shape[-1], dtype=mean.dtype, device=mean.device)
    P = covariance + drift * identity
    PC = _times(P, C.mT)
    S = _times(PC.mT, C.mT) + noise
    # S is positive definite (Sigma_z has a floor), so only inputs that are not finite could fail
    # here, and they show in the result: the _ex variant leaves out a check on every step.
    S_inverse = torch.cholesky_inverse(torch.linalg.cholesky_ex(S).L)
    gain = PC @ S_inverse
    innovation = z - mean @ C.mT
    shrinkage = identity - _times(gain, C)
    joseph = shrinkage @ P @ shrinkage.mT + gain @ noise @ gain.mT
    return FilterStep(
        mean=mean + _times_vector(gain, innovation),
        covariance=0.5 * (joseph + joseph.mT),
        gain=gain,
        shrinkage=shrinkage,
        residual=_times_vector(S_inverse, innovation),
    )


def filter_means(
    mean: Tensor, covariance: Tensor, z: Tensor, noise: Tensor, C: Tensor, drift: float
) -> Tensor:
    """Means of phi after 0, 1, ..., N measurements, (M, B, N + 1, h): `kalman_step` in a loop.

    Arguments as in `kalman_step`, with z (M, B, N, k) and noise (M, B, N, k, k). The gradient is a
    hand-written adjoint of matrix products only, faster than differentiating the loop.
    """
    return _FilterMeans.apply(mean, covariance, z, noise, C, drift)


class _FilterMeans(torch.autograd.Function):
    """Filter recursion with its adjoint."""

    @staticmethod
    def forward(
        ctx: Any,
        mean: Tensor,
        covariance: Tensor,
        z: Tensor,
        noise: Tensor,
        C: Tensor,
        drift: float,
    ) -> Tensor:
        ctx.save_for_backward(C)
        ctx.steps = []
        means = [mean]
        for z_i, noise_i in zip(z.unbind(2), noise.unbind(2), strict=True):
            step = kalman_step(mean, covariance, z_i, noise_i, C, drift)
            mean, covariance = step.mean, step.covariance
            means.append(mean)
            ctx.steps.append(step)
        return torch.stack(means, dim=2)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Adjoint of the recursion, backwards in time.

        With l = dL/dmu and G = dL/dSigma_phi (symmetric) after a step, k = K' l, a = (I - K C)' l
        and Sigma, mu the step's results, differentiating eqs. (kalmangain) to (sigma_update) gives

            dL/dz       = k
            dL/dSigma_z = K' G K - k y'
            dL/dC       = y (Sigma l)' - k mu' - 2 K' G Sigma
            l <- a + dL/dmu of the step before
            G <- (I - K C)' G (I - K C) + sym(a (C' y)')
        """
        (C,) = ctx.saved_tensors
        per_step = gradients[0]
        l_mean = per_step[:, :, -1]
        l_cov = l_mean.new_zeros(*l_mean.shape, l_mean.shape[-1])
        l_z = l_mean.new_empty(*l_mean.shape[:2], len(ctx.steps), C.shape[1])
        l_noise = l_z.new_empty(*l_z.shape, C.shape[1])
        l_C = torch.zeros_like(C)
        for i in reversed(range(len(ctx.steps))):
            step = ctx.steps[i]
            k = _times_vector(step.gain.mT, l_mean)
            a = _times_vector(step.shrinkage.mT, l_mean)
            GK = l_cov @ step.gain
            l_z[:, :, i] = k
            l_noise[:, :, i] = step.gain.mT @ GK - k[..., :, None] * step.residual[..., None, :]
            l_C += step.residual.mT @ _times_vector(step.covariance, l_mean)
            l_C -= k.mT @ step.mean
            l_C -= 2 * GK.flatten(1, 2).mT @ step.covariance.flatten(1, 2)
            outer = a[..., :, None] * (step.residual @ C)[..., None, :]
            l_cov = step.shrinkage.mT @ l_cov @ step.shrinkage + 0.5 * (outer + outer.mT)
            l_mean = a + per_step[:, :, i]
        return l_mean, l_cov, l_z, l_noise, l_C, None


def _positive_diagonal(raw: Tensor) -> Tensor:
    """Lower triangle of raw (..., h, h) with its diagonal made positive by softplus."""
    below = torch.ones_like(raw[(0,) * (raw.ndim - 2)]).tril(-1)
    return raw * below + torch.diag_embed(functional.softplus(raw.diagonal(dim1=-2, dim2=-1)))


def _times(X: Tensor, Y: Tensor) -> Tensor:
    """X Y for X (M, B, r, h) and Y (M, h, c): one product per model rather than one per task."""
    return (X.reshape(X.shape[0], -1, X.shape[-1]) @ Y).view(*X.shape[:-1], Y.shape[-1])


def _times_vector(X: Tensor, v: Tensor) -> Tensor:
    """X v for X (M, B, r, c) and v (M, B, c)."""
    return (X @ v[..., None])[..., 0]


class Kalman(AdaptationMethod[KalmanBelief]):
    """The paper's method: measurement network, Kalman filter, prediction network."""

    Settings = KalmanSettings

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
        """Measurement model mu_z, Sigma_z = f^m(s, a, s~').

        Sigma_z = L L' + floor I, with L the lower triangle predicted by the network. One sample
        fixes some directions of phi and leaves others open, and which ones depends on (s, a): a
        diagonal Sigma_z could only weigh fixed directions, the rows of C. On tasks y = W x with W
        2 x 2 it left 1.5 times the squared error after 15 samples with twice the parameters.

        Inputs are (M, ..., d), results (M, ..., h) and (M, ..., h, h).
        """
        out = self.measurement_net(torch.cat([state, action, observed], dim=-1))
        h = self.settings.latent
        mean, packed = out.split([h, out.shape[-1] - h], dim=-1)
        # Every packed value appears once on or below the diagonal of this square; indexing with
        # tril_indices would do the same with a slower gradient.
        square = torch.cat([packed[..., h:], packed.flip(-1)], dim=-1).unflatten(-1, (h, h))
        L = _positive_diagonal(square)
        floor = VARIANCE_FLOOR * torch.eye(h, dtype=L.dtype, device=L.device)
        return mean, L @ L.mT + floor

    def update(self, belief: KalmanBelief, state: Tensor, action: Tensor, observed: Tensor) -> KalmanBelief:
        """Measure one sample (M, B, d) and integrate it; see `kalman_step`."""
        return self._integrate(belief, *self.measure(state, action, observed))

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
        measured = self.measure(state, action, observed)
        for z, noise in zip(*(x.unbind(2) for x in measured), strict=True):
            beliefs.append(self._integrate(beliefs[-1], z, noise))
        return beliefs

    def sequence_predictions(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        """Predict each outcome from the samples before it; both networks run only once."""
        prior = self.prior(state.shape[1])
        # Prediction i is made from the belief after samples 0, ..., i - 1; the last is never used.
        z, noise = self.measure(state[:, :, :-1], action[:, :, :-1], observed[:, :, :-1])
        means = filter_means(prior.mean, prior.covariance, z, noise, self.C, self.settings.drift)
        return self.outcome(means, state, action)

    def sample_phi(self, belief: KalmanBelief, samples: int, generator: torch.Generator) -> Tensor:
        """Draw phi ~ N(mu_phi, Sigma_phi), (M, B, samples, h), for predictive intervals."""
        models, tasks, h = belief.mean.shape
        # Drawn where the generator lives: a seed on the CPU means the same on every device.
        white = torch.randn(models, tasks, samples, h, generator=generator, device=generator.device)
        L = torch.linalg.cholesky_ex(belief.covariance).L
        return belief.mean[:, :, None] + white.to(L) @ L.mT

    def _integrate(self, belief: KalmanBelief, z: Tensor, noise: Tensor) -> KalmanBelief:
        step = kalman_step(belief.mean, belief.covariance, z, noise, self.C, self.settings.drift)
        return KalmanBelief(step.mean, step.covariance)


METHOD = Kalman
