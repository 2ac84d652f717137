"""Prediction intervals against closed forms: a Kalman method without hidden layers is linear in phi."""

import math

import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats
from scipy.spatial.distance import mahalanobis
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.intervals import (
    Calibration,
    Predictive,
    SamplesPhi,
    calibrate,
    predictive,
    raw_radius2,
)
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.lstm import Lstm
from slapshot.adaptation.method import Sizes
from slapshot.config.methods import KalmanSettings, LstmSettings
from slapshot.errors import InputError

SIZES = Sizes(state=2, action=3, outcome=2)
M, B, Q, H = 2, 3, 4, 3
LEAST = 1e-6  # m², added to every variance


@pytest.fixture(autouse=True)
def one_thread():
    """Tensors this small only wait for a second thread, very long where another process has it."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def make_linear(tasks: int = B) -> tuple[Kalman, Standardiser, KalmanBelief]:
    """A method whose outcome is linear in phi, and a belief that differs between models and tasks."""
    g = generator(0)
    method = Kalman(SIZES, KalmanSettings.model_construct(latent=H, hidden=(), drift=0.0), M, g)
    scale = {"state": torch.ones(2), "action": torch.ones(3), "outcome": torch.tensor([0.5, 2.0])}
    mean = {"state": torch.zeros(2), "action": torch.zeros(3), "outcome": torch.tensor([1.0, -3.0])}
    factor = torch.randn(M, tasks, H, H, generator=g)
    covariance = factor @ factor.mT + 0.1 * torch.eye(H)
    belief = KalmanBelief(torch.randn(M, tasks, H, generator=g), covariance)
    return method, Standardiser(mean, scale), belief


def draw_queries(tasks: int = B, queries: int = Q) -> tuple[torch.Tensor, torch.Tensor]:
    g = generator(1)
    return tuple(torch.randn(M, tasks, queries, d, generator=g) for d in (SIZES.state, SIZES.action))


def exact_covariance(method: Kalman, standardiser: Standardiser, belief: KalmanBelief) -> torch.Tensor:
    """D J Sigma J' D in m², (M, B, 2, 2), with J = d outcome / d phi and D the outcome's scale."""
    J = method.prediction_net.weights[0][:, SIZES.state + SIZES.action :].mT[:, None].detach().double()
    D = standardiser.scale["outcome"].double().diag()
    return D @ J @ belief.covariance.double() @ J.mT @ D


def test_a_linear_prediction_has_the_covariance_of_its_closed_form():
    method, standardiser, belief = make_linear()
    state, action = draw_queries()
    draws = 4000
    found = predictive(method, standardiser, belief, state, action, draws, generator(2))
    exact = exact_covariance(method, standardiser, belief)[:, :, None] + LEAST * torch.eye(2)
    # Var of a sample covariance's entry: (S_ii S_jj + S_ij²) / (n - 1) for a Gaussian.
    variances = exact.diagonal(dim1=-2, dim2=-1)
    spread = variances[..., :, None] * variances[..., None, :] + exact.square()
    assert found.covariance.shape == (M, B, Q, 2, 2)
    assert ((found.covariance - exact).abs() < 6 * (spread / (draws - 1)).sqrt()).all()
    # The mean is no average of draws: it is the prediction itself, in metres.
    expected = standardiser.restore("outcome", method.predict(belief, state, action))
    torch.testing.assert_close(found.mean, expected)


def test_truths_drawn_from_the_belief_lie_as_far_as_hotelling_says():
    """x' S^-1 x of x ~ N(0, Sigma), S from n independent draws: 2 (n - 1) / (n - 2) F(2, n - 2)."""
    tasks, draws = 1000, 32
    method, standardiser, belief = make_linear(tasks)
    state, action = draw_queries(tasks, 1)
    found = predictive(method, standardiser, belief, state, action, draws, generator(3))
    true_phi = method.sample_phi(belief, 1, generator(4))
    with torch.no_grad():
        truths = standardiser.restore("outcome", method.outcome(true_phi, state, action))
    for m in range(M):
        # Truths (B, Q, 2) are everybody's: model m's own are used for model m.
        distance = found.squared_distance(truths[m])[m].flatten().numpy() * (draws - 2) / (2 * (draws - 1))
        empirical = stats.kstest(distance, stats.f(2, draws - 2).cdf).statistic
        # Dvoretzky, Kiefer, Wolfowitz: above this once in 1e6.
        assert empirical < math.sqrt(math.log(2e6) / (2 * tasks))


def test_draws_that_agree_keep_a_covariance_that_can_be_inverted():
    method, standardiser, belief = make_linear()
    belief = KalmanBelief(belief.mean, 1e-20 * belief.covariance)
    state, action = draw_queries()
    found = predictive(method, standardiser, belief, state, action, 4, generator(5))
    torch.testing.assert_close(found.covariance, (LEAST * torch.eye(2)).double().expand(M, B, Q, 2, 2))
    assert torch.isfinite(found.squared_distance(found.mean[0])).all()


def test_the_seed_decides():
    method, standardiser, belief = make_linear()
    state, action = draw_queries()
    first, again, other = (
        predictive(method, standardiser, belief, state, action, 8, generator(s)).covariance for s in (1, 1, 2)
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_distance_and_area_are_those_of_the_ellipse():
    g = generator(6)
    factor = torch.randn(M, B, Q, 2, 2, generator=g, dtype=torch.float64)
    covariance = factor @ factor.mT + 0.1 * torch.eye(2)
    mean = torch.randn(M, B, Q, 2, generator=g)
    truth = torch.randn(B, Q, 2, generator=g)
    found = Predictive(mean, covariance)
    for m, b, q in np.ndindex(M, B, Q):
        inverse = np.linalg.inv(covariance[m, b, q].numpy())
        distance = mahalanobis(truth[b, q].double().numpy(), mean[m, b, q].double().numpy(), inverse)
        assert found.squared_distance(truth)[m, b, q].item() == pytest.approx(distance**2, rel=1e-10)
        axes = np.sqrt(np.linalg.eigvalsh(covariance[m, b, q].numpy()))
        assert found.area()[m, b, q].item() == pytest.approx(np.pi * axes.prod(), rel=1e-10)


def test_a_method_without_a_belief_is_refused_in_one_line():
    method = Lstm(SIZES, LstmSettings(state=4, hidden=(4,)), M, generator(0))
    assert not isinstance(method, SamplesPhi)
    _, standardiser, _ = make_linear()
    with pytest.raises(InputError, match=r"uncertainty\.method: Lstm has no belief .*; use kalman") as caught:
        predictive(method, standardiser, method.prior(B), *draw_queries(), 4, generator(0))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("level", [1e-9, 0.05, 0.5, 0.9, 0.999])
def test_raw_radius_is_the_quantile_of_chi_squared(level):
    assert raw_radius2(level) == pytest.approx(stats.chi2.ppf(level, 2), rel=1e-9)


@pytest.mark.parametrize("level", [0.5, 0.9])
def test_calibrated_radius_reaches_its_level_on_fresh_data(level):
    """Whatever the distances' distribution, and for each model its own."""
    rng = np.random.default_rng(7)
    count, shape = 4000, (40, 100)

    def draw() -> np.ndarray:
        return np.stack([rng.chisquare(2, shape), 7 * rng.lognormal(0, 2, shape), rng.pareto(1.5, shape)])

    radius2 = calibrate(draw(), level)
    assert radius2.shape == (3,)
    covered = (draw() <= radius2[:, None, None]).mean((1, 2))
    # The quantile of n values covers p give or take sqrt(p (1 - p) / n), and so does counting n fresh ones.
    assert np.abs(covered - level).max() < 5 * math.sqrt(2 * level * (1 - level) / count)


def test_calibration_is_looked_up_by_model_level_and_samples():
    keys = [(m, s, p) for m in (0, 1) for s in (8, 0, 2) for p in (0.5, 0.9)]
    table = pd.DataFrame(keys, columns=["model", "samples", "level"])
    table["radius2"] = 100 * table["model"] + table["samples"] + table["level"]
    calibration = Calibration(table)
    assert calibration.radius2(0, 2, 0.5) == 2.5
    assert calibration.radius2(1, 0, 0.9) == 100.9
    # Between measured numbers of samples the smaller one counts, beyond them the largest.
    assert calibration.radius2(1, 7, 0.5) == 102.5
    assert calibration.radius2(0, 99, 0.9) == 8.9
