"""The Kalman method: its filter against exact inference, its networks, its innovations."""

import math

import numpy as np
import pytest
import torch
from pydantic import ValidationError
from scipy import stats
from slapshot.adaptation.fused_filter import filter_means
from slapshot.adaptation.kalman import (
    Kalman,
)
from slapshot.adaptation.kalman_filter import kalman_step
from slapshot.adaptation.measurement import LARGEST_FACTOR, measurement_size, square, unpack
from slapshot.adaptation.method import Sizes
from slapshot.config.methods import KalmanSettings
from torch import Tensor

SIZES = Sizes(state=2, action=3, outcome=2)
SETTINGS = KalmanSettings(latent=4, hidden=(16, 16), drift=1e-3)


@pytest.fixture(autouse=True)
def one_thread():
    """Tensors this small only wait for a second thread, very long where another process has it."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def draw_covariances(*lead: int, size: int, g: torch.Generator) -> Tensor:
    factor = torch.randn(*lead, size, size, generator=g, dtype=torch.float64)
    return factor @ factor.mT + 0.1 * torch.eye(size, dtype=torch.float64)


def draw_data(samples: int) -> list[Tensor]:
    """State, action and observed outcome of two models and three tasks."""
    g = generator(1)
    sizes = (SIZES.state, SIZES.action, SIZES.outcome)
    return [torch.randn(2, 3, samples, d, generator=g, dtype=torch.float64) for d in sizes]


@pytest.fixture
def method() -> Kalman:
    return Kalman(SIZES, SETTINGS, 2, generator()).double()


def whiten(z: Tensor, noise: Tensor, C: Tensor) -> tuple[Tensor, Tensor]:
    """y = L' z and H = L' C with L L' = noise^-1, for z (M, B, N, k), C (M, k, h)."""
    L = torch.linalg.cholesky(noise.inverse())
    return (L.mT @ z[..., None])[..., 0], L.mT @ C[:, None, None]


def outputs_for(z: Tensor, noise: Tensor) -> Tensor:
    """What a measurement network would say to mean z (..., k) and noise (..., k, k)."""
    k = z.shape[-1]
    L = torch.linalg.cholesky(noise.inverse())
    rows, columns = torch.tril_indices(k, k)
    diagonal = torch.diag_embed(L.diagonal(dim1=-2, dim2=-1))
    raw = L - diagonal + diagonal.expm1().log().nan_to_num(neginf=0)  # softplus, inverted
    outputs = torch.empty(*z.shape[:-1], measurement_size(k), dtype=z.dtype)
    outputs[..., :k] = z
    outputs[..., k + square(torch.arange(len(rows)), k)[rows, columns]] = raw[..., rows, columns]
    return outputs


def run_filter(mean, covariance, y, H, drift) -> tuple[Tensor, Tensor]:
    """Means (M, B, N + 1, h) and covariances (M, B, N + 1, h, h) by single steps."""
    means, covariances = [mean], [covariance]
    for i in range(y.shape[2]):
        step = kalman_step(means[-1], covariances[-1], y[:, :, i], H[:, :, i], drift)
        means.append(step.mean)
        covariances.append(step.covariance)
    return torch.stack(means, 2), torch.stack(covariances, 2)


@pytest.mark.parametrize("k", [2, 3, 4])
def test_filter_conditions_the_joint_gaussian(k):
    """Against the joint of the chain phi_0, ..., phi_N and all measurements, inverted at once."""
    M, B, N, h, drift = 2, 2, 6, 3, 0.2
    g = generator()
    mean = torch.randn(M, B, h, generator=g, dtype=torch.float64)
    covariance = draw_covariances(M, B, size=h, g=g)
    z = torch.randn(M, B, N, k, generator=g, dtype=torch.float64)
    noise = draw_covariances(M, B, N, size=k, g=g)
    C = torch.randn(M, k, h, generator=g, dtype=torch.float64)
    y, H = whiten(z, noise, C)
    means, covariances = run_filter(mean, covariance, y, H, drift)
    fast = filter_means(mean, covariance, outputs_for(z, noise), C, drift)
    for m, b in np.ndindex(M, B):
        P, c = covariance[m, b].numpy(), C[m].numpy()
        for n in range(1, N + 1):
            # phi_i = phi_0 + drift steps, so Cov(phi_i, phi_j) = P + min(i, j) drift I.
            steps = np.arange(1, n + 1)
            shared = np.minimum.outer(steps, steps)
            prior = np.kron(np.ones((n, n)), P) + drift * np.kron(shared, np.eye(h))
            observe = np.kron(np.eye(n), c)
            S = observe @ prior @ observe.T
            for i in range(n):
                S[i * k : (i + 1) * k, i * k : (i + 1) * k] += noise[m, b, i].numpy()
            gain = np.linalg.solve(S, observe @ prior[:, -h:]).T
            residual = (z[m, b, :n] - C[m] @ mean[m, b]).numpy().ravel()
            exact_mean = mean[m, b].numpy() + gain @ residual
            exact_covariance = prior[-h:, -h:] - gain @ observe @ prior[:, -h:]
            # S has eigenvalues within about 0.1 to 100: float64 leaves some 1e-13.
            np.testing.assert_allclose(means[m, b, n], exact_mean, rtol=0, atol=1e-10)
            np.testing.assert_allclose(fast[m, b, n], exact_mean, rtol=0, atol=1e-10)
            np.testing.assert_allclose(covariances[m, b, n], exact_covariance, rtol=0, atol=1e-10)


def test_without_drift_it_is_bayesian_linear_regression():
    """y = x'w + noise, where sample i measures w through C = x_i'."""
    N, h, variance = 12, 4, 0.3
    g = generator(2)
    mean = torch.randn(1, 1, h, generator=g, dtype=torch.float64)
    covariance = draw_covariances(1, 1, size=h, g=g)
    X = torch.randn(N, h, generator=g, dtype=torch.float64)
    y = torch.randn(N, generator=g, dtype=torch.float64)
    sd = math.sqrt(variance)
    means, covariances = run_filter(
        mean, covariance, (y / sd)[None, None, :, None], (X / sd)[None, None, :, None], 0.0
    )
    precision = covariance[0, 0].inverse() + X.mT @ X / variance
    right = covariance[0, 0].inverse() @ mean[0, 0] + X.mT @ y / variance
    # Condition numbers below 1e3: float64 leaves some 1e-13.
    exact = torch.linalg.solve(precision, right)
    torch.testing.assert_close(means[0, 0, -1], exact, rtol=0, atol=1e-10)
    torch.testing.assert_close(covariances[0, 0, -1], precision.inverse(), rtol=0, atol=1e-10)


def test_adjoint_equals_the_differentiated_loop(method):
    state, action, observed = draw_data(6)
    gradients = []
    for predict in (method.sequence_predictions, super(Kalman, method).sequence_predictions):
        method.zero_grad()
        method.sequence_loss(predict(state, action, observed), observed).backward()
        gradients.append({name: p.grad.clone() for name, p in method.named_parameters()})
    for name, plain in gradients[1].items():
        assert plain.abs().max() > 0, name
        # Float64 rounding in sums of some 1e3 terms, relative to the largest entry.
        scale = plain.abs().max().item()
        torch.testing.assert_close(gradients[0][name], plain, rtol=0, atol=1e-12 * scale, msg=name)


@pytest.mark.parametrize("drift", [0.0, 1e-4, 1.0])
def test_covariance_stays_positive_definite(drift):
    """10,000 updates, each with standard deviations from the smallest possible, 1e-2, to 1e4."""
    B, h, bank = 1, 16, 200
    g = generator(3)
    rotation = torch.linalg.qr(torch.randn(bank, B, h, h, generator=g)).Q
    L = rotation * LARGEST_FACTOR * 1e-6 ** torch.rand(bank, B, 1, h, generator=g)
    C = torch.eye(h) + 0.1 * torch.randn(h, h, generator=g)
    H = (L.mT @ C)[None]
    mean, covariance = torch.zeros(1, B, h), torch.eye(h).expand(1, B, h, h)
    # Sigma = (P^-1 + H'H)^-1 with P >= drift I: its eigenvalues are at least
    # 1 / (1 / drift + max |H|^2). Float32 may take a part of that, not half.
    information = torch.linalg.matrix_norm(H, ord=2).max().item() ** 2
    smallest = 0.5 / (1 / drift + information) if drift else 0.0
    for i in range(10_000):
        y = torch.randn(1, B, h, generator=g)
        step = kalman_step(mean, covariance, y, H[:, i % bank], drift)
        mean, covariance = step.mean, step.covariance
        if i < 100 or i % 100 == 99:
            assert torch.equal(covariance, covariance.mT)
            assert torch.linalg.eigvalsh(covariance.double()).min() > smallest
    assert torch.isfinite(mean).all()


def test_order_of_samples_matters_only_with_drift():
    for drift, matters in ((0.0, False), (0.1, True)):
        settings = KalmanSettings(latent=4, hidden=(16,), drift=drift)
        method = Kalman(SIZES, settings, 2, generator()).double()
        data = draw_data(8)
        order = torch.randperm(8, generator=generator(4))
        with torch.no_grad():
            one = method.adapt(*data)[-1]
            other = method.adapt(*(x[:, :, order] for x in data))[-1]
        # Float64 rounding of eight well-conditioned updates against an effect of order drift.
        assert torch.allclose(one.mean, other.mean, rtol=0, atol=1e-11) is not matters
        assert torch.allclose(one.covariance, other.covariance, rtol=0, atol=1e-11) is not matters


def test_precise_measurement_of_a_wide_prior():
    """Variance 1e4, then 1e-4 in every direction: (I - K C) P would leave rounding of 1e-3."""
    h = 16
    g = generator(8)
    R = torch.linalg.qr(torch.randn(2, h, h, generator=g, dtype=torch.float64)).Q
    spread = 1e4 * (0.2 + torch.rand(h, generator=g, dtype=torch.float64))
    P = ((R[0] * spread) @ R[0].mT)[None, None]
    H = LARGEST_FACTOR * R[1][None, None]
    zero = torch.zeros(1, 1, h)
    step = kalman_step(zero, P.float(), zero, H.float(), 0.0)
    exact = (P.inverse() + H.mT @ H).inverse()
    # In Joseph's form an error d of I - K H costs d^2 |P|. Here d is some h cond(S) 2^-24 = 6e-6
    # (cond(S) is 6), so 4e-7 of the exact 1e-4: 0.4 %.
    torch.testing.assert_close(step.covariance.double(), exact, rtol=0, atol=0.004 / LARGEST_FACTOR**2)


def test_measurement_factor_is_full_bounded_and_depends_on_the_sample(method):
    mean, L = method.measure(*draw_data(5))
    assert (mean.shape, L.shape) == ((2, 3, 5, 4), (2, 3, 5, 4, 4))
    below = torch.ones(4, 4, dtype=torch.bool).tril()
    assert (L[..., ~below] == 0).all()
    assert (L.diagonal(dim1=-2, dim2=-1) > 0).all()
    assert (L.std(dim=2)[..., below] > 0).all()  # heteroscedastic in every entry
    (mean.sum() + L.sum()).backward()
    gradient = method.measurement_net.biases[-1].grad
    assert gradient is not None
    assert gradient.shape[-1] == 4 + 10
    assert (gradient != 0).all()  # every output of the network is used
    # Absurd inputs cannot make a measurement more precise than float32 carries.
    _, L = method.measure(*(1e6 * x for x in draw_data(5)))
    assert L.abs().max() == LARGEST_FACTOR


def test_packed_outputs_are_unpacked():
    g = generator(7)
    z, noise = torch.randn(5, 3, generator=g, dtype=torch.float64), draw_covariances(5, size=3, g=g)
    mean, L = unpack(outputs_for(z, noise), 3)
    assert torch.equal(mean, z)
    # Condition numbers below 1e3 in float64.
    torch.testing.assert_close(L @ L.mT, noise.inverse(), rtol=1e-12, atol=1e-12)


def test_whitened_measurement_is_the_measurement(method):
    mean, L = method.measure(*draw_data(5))
    y, H = method.whiten(mean, L)
    for m, b, i in np.ndindex(2, 3, 5):
        # Products of 4 numbers of order 1 in float64.
        torch.testing.assert_close(y[m, b, i], L[m, b, i].mT @ mean[m, b, i], rtol=0, atol=1e-14)
        torch.testing.assert_close(H[m, b, i], L[m, b, i].mT @ method.C[m], rtol=0, atol=1e-14)


def test_queries_broadcast_over_sampled_parameters(method):
    state, action, _ = draw_data(5)
    phi = method.sample_phi(method.prior(3), 7, generator(5))
    outcomes = method.outcome(phi[:, :, :, None], state[:, :, None], action[:, :, None])
    assert outcomes.shape == (2, 3, 7, 5, 2)
    torch.testing.assert_close(
        outcomes[:, :, 4, 1], method.outcome(phi[:, :, 4], state[:, :, 1], action[:, :, 1])
    )


def test_sampled_parameters_have_the_beliefs_moments(method):
    with torch.no_grad():
        belief = method.adapt(*draw_data(4))[-1]
        n = 20_000
        phi = method.sample_phi(belief, n, generator(6))
    error = phi.mean(2) - belief.mean
    variance = belief.covariance.diagonal(dim1=-2, dim2=-1)
    assert (error.abs() < 6 * (variance / n).sqrt()).all()
    centred = phi - belief.mean[:, :, None]
    error = centred.mT @ centred / n - belief.covariance
    # Var(x_i x_j) = S_ii S_jj + S_ij^2 for a Gaussian with covariance S.
    spread = variance[..., :, None] * variance[..., None, :] + belief.covariance.square()
    assert (error.abs() < 6 * (spread / n).sqrt()).all()


@pytest.mark.parametrize("wrong", [{"latent": 0}, {"hidden": (8, 0)}, {"drift": -1e-3}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        KalmanSettings(**({"latent": 2, "hidden": (8,), "drift": 0.0} | wrong))


def test_parameter_count():
    method = Kalman(SIZES, SETTINGS, 3, generator())
    h, w = 4, 16
    measurement = (7 + 1) * w + (w + 1) * w + (w + 1) * (h + h * (h + 1) // 2)
    prediction = (5 + h + 1) * w + (w + 1) * w + (w + 1) * 2
    # C, prior mean and the prior's factor; the factor's upper triangle stays unused.
    assert method.parameter_count() == measurement + prediction + h * h + h + h * h


class Measures(Kalman):
    """Its measurement is the outcome itself, with a precision of its own for each sample."""

    def measure(self, state: Tensor, action: Tensor, observed: Tensor) -> tuple[Tensor, Tensor]:
        # State and action carry the lower triangle of L, Sigma_z^-1 = L L'.
        packed = torch.cat([state, action], -1)
        L = torch.zeros(*packed.shape[:-1], 2, 2, dtype=packed.dtype)
        L[..., 0, 0], L[..., 1, 0], L[..., 1, 1] = packed.unbind(-1)
        return observed, L


def measuring(tasks: int, drift: float) -> tuple[Measures, tuple[Tensor, Tensor, Tensor, Tensor]]:
    """A filter of two dimensions, with sequences (M, B, N, ...) drawn from its own model: z and L."""
    g, (M, N) = generator(9), (2, 5)
    method = Measures(Sizes(1, 2, 2), KalmanSettings(latent=2, hidden=(4,), drift=drift), M, g).double()
    with torch.no_grad():
        method.C.normal_(generator=g)
        method.prior_mean.normal_(generator=g)
        method.prior_factor.normal_(generator=g)
    packed = 0.5 + torch.rand(M, tasks, N, 3, generator=g, dtype=torch.float64)
    L = torch.zeros(M, tasks, N, 2, 2, dtype=torch.float64)
    L[..., 0, 0], L[..., 1, 0], L[..., 1, 1] = packed.unbind(-1)

    def normal(*shape: int) -> Tensor:
        return torch.randn(M, tasks, *shape, generator=g, dtype=torch.float64)

    with torch.no_grad():
        phi = method.sample_phi(method.prior(tasks), 1, g).double()
        phi = phi + math.sqrt(drift) * normal(N, 2).cumsum(2)
        # L'^-1 times white noise has the covariance (L L')^-1.
        noise = torch.linalg.solve(L.mT, normal(N, 2)[..., None])[..., 0]
        z = phi @ method.C[:, None].mT + noise
    return method, (packed[..., :1], packed[..., 1:], z, L)


def test_innovations_are_those_of_the_filter_before_whitening():
    """r' S^-1 r with r = z - C mu and S = C (Sigma + Q) C' + Sigma_z."""
    drift = 0.3
    method, (state, action, z, L) = measuring(3, drift)
    with torch.no_grad():
        beliefs = method.adapt(state, action, z)
        for i in range(z.shape[2]):
            found = method.normalised_innovation_squared(
                beliefs[i], *(x[:, :, i] for x in (state, action, z))
            )
            for m, b in np.ndindex(2, 3):
                C, factor = method.C[m].numpy(), L[m, b, i].numpy()
                P = beliefs[i].covariance[m, b].numpy() + drift * np.eye(2)
                S = C @ P @ C.T + np.linalg.inv(factor @ factor.T)
                r = z[m, b, i].numpy() - C @ beliefs[i].mean[m, b].numpy()
                # Condition numbers below 1e4: float64 leaves some 1e-12.
                assert found[m, b].item() == pytest.approx(r @ np.linalg.inv(S) @ r, rel=1e-9)


def test_innovations_of_the_filters_own_model_are_chi_squared():
    """And independent over time, so that all samples of a task count."""
    tasks = 2000
    method, (state, action, z, _) = measuring(tasks, 0.3)
    with torch.no_grad():
        beliefs = method.adapt(state, action, z)
        nis = torch.stack(
            [
                method.normalised_innovation_squared(beliefs[i], *(x[:, :, i] for x in (state, action, z)))
                for i in range(z.shape[2])
            ]
        ).numpy()
    for n in (*nis, nis.ravel()):
        # Dvoretzky, Kiefer, Wolfowitz: above this once in 1e6.
        assert stats.kstest(n.ravel(), stats.chi2(2).cdf).statistic < math.sqrt(math.log(2e6) / (2 * n.size))
    # Correlations of independent values: 0, give or take 1 / sqrt(count).
    flat = nis.reshape(len(nis), -1)
    correlations = np.corrcoef(flat)[~np.eye(len(nis), dtype=bool)]
    assert np.abs(correlations).max() < 5 / math.sqrt(flat.shape[1])
