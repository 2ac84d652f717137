"""Linear regression: the exact posterior against other computations, the trained filter against it."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from slapshot.adaptation import regression
from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.kalman import Kalman
from slapshot.adaptation.regression import COUNTS, Lines, exact_beliefs, exact_curve, values
from slapshot.command import Run

LINES = Lines(slope_sd=1.0, intercept_sd=0.7, x_range=2.0)
NOISE = 0.25
DRIFT = 1e-4
CONFIG = {
    "seed": 1,
    "kalman": {"latent": 2, "hidden": [32, 32], "drift": DRIFT},
    "training": {
        "models": 2, "steps": 400, "tasks": 32, "sequence": 12, "learning_rate": 0.01,
        "noise_variance_max": 2 * NOISE,
    },
    "slope_sd": 1.0,
    "intercept_sd": 1.0,
    "x_range": 2.0,
    "walkthrough": {"samples": [0, 2, 10], "noise_variance": NOISE},
    "tasks": 8,
}  # fmt: skip


@pytest.fixture(autouse=True, scope="module")
def threads():
    """The stage sets torch's number of threads; other tests get theirs back."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("regression")
    regression.produce(Run(CONFIG, {}, out, 2))
    return out


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def draw(tasks: int, samples: int, models: int = 1, lines: Lines = LINES):
    return lines.draw((models, tasks), samples, torch.tensor(NOISE), generator(3))


def test_lines_have_the_stated_spreads():
    n = 20_000
    tasks = draw(n, 1)
    for value, sd in zip(tasks.line[0].unbind(-1), (LINES.slope_sd, LINES.intercept_sd), strict=True):
        assert abs(value.mean()) < 6 * sd / math.sqrt(n)
        # Var(s^2) = 2 sd^4 / n of a Gaussian.
        assert abs(value.square().mean() - sd**2) < 6 * sd**2 * math.sqrt(2 / n)
    x, noise = tasks.batch.state, tasks.batch.observed - tasks.batch.outcome
    assert x.abs().max() <= LINES.x_range
    # U(-r, r): variance r^2 / 3, and E x^4 - (r^2 / 3)^2 = 4 r^4 / 45.
    assert abs(x.square().mean() - LINES.x_range**2 / 3) < 6 * LINES.x_range**2 * math.sqrt(4 / 45 / n)
    assert abs(noise.square().mean() - NOISE) < 6 * NOISE * math.sqrt(2 / n)
    assert tasks.batch.action.shape == (1, n, 1, 0)


@pytest.mark.parametrize("samples", [0, 1, 3])
def test_exact_posterior_is_the_integral_over_a_grid(samples):
    """Prior times likelihood, normalised and integrated numerically over (w, b)."""
    tasks = draw(1, 3)
    x = tasks.batch.state[0, 0, :samples].double().numpy()
    y = tasks.batch.observed[0, 0, :samples].double().numpy()
    # Eight prior standard deviations each way; the narrowest posterior is a hundred steps wide, where
    # the sum over a grid of a smooth density that ends at 0 is exact to rounding.
    axis = np.linspace(-8, 8, 1601)
    w, b = axis[:, None] * LINES.slope_sd, axis[None, :] * LINES.intercept_sd
    exponent = -0.5 * ((w / LINES.slope_sd) ** 2 + (b / LINES.intercept_sd) ** 2)
    for x_i, y_i in zip(x[:, 0], y[:, 0], strict=True):
        exponent = exponent - 0.5 * (y_i - w * x_i - b) ** 2 / NOISE
    weight = np.exp(exponent - exponent.max())
    weight /= weight.sum()
    mean = np.array([(weight * w).sum(), (weight * b).sum()])
    dw, db = w - mean[0], b - mean[1]
    cross = (weight * dw * db).sum()
    covariance = np.array([[(weight * dw**2).sum(), cross], [cross, (weight * db**2).sum()]])
    exact = exact_beliefs(LINES, tasks.batch.state, tasks.batch.observed, NOISE)
    # Rounding of 2.6 million terms, and what lies beyond eight standard deviations: 1e-13 of the mass.
    np.testing.assert_allclose(exact.mean[0, 0, samples], mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(exact.covariance[0, 0, samples], covariance, rtol=0, atol=1e-9)


def test_exact_spread_of_y_is_that_of_sampled_lines():
    tasks = draw(1, 2)
    exact = exact_beliefs(LINES, tasks.batch.state, tasks.batch.observed, NOISE)
    grid, n = LINES.grid(5), 20_000
    curve = exact_curve(exact, grid)
    L = torch.linalg.cholesky(exact.covariance[0, 0])
    for count in range(3):
        white = torch.randn(n, 2, generator=generator(4), dtype=torch.float64)
        drawn = values(exact.mean[0, 0, count] + white @ L[count].mT, grid[:, None])[..., 0]
        mean, sd = curve.mean[0, 0, count], curve.sd[0, 0, count]
        assert ((drawn.mean(0) - mean).abs() < 6 * sd / math.sqrt(n)).all()
        assert ((drawn.std(0) - sd).abs() < 6 * sd / math.sqrt(2 * n)).all()


def test_trained_filter_comes_near_the_exact_posterior(folder):
    method, _ = load_ensemble(folder)
    lines = Lines(CONFIG["slope_sd"], CONFIG["intercept_sd"], CONFIG["x_range"])
    n = 2000
    tasks = draw(n, 11, models=2, lines=lines)
    batch = tasks.batch
    with torch.no_grad():
        predicted = method.sequence_predictions(batch.state, batch.action, batch.observed)
    exact = exact_beliefs(lines, batch.state, batch.observed, NOISE)
    best = (exact.mean[:, :, :-1] * torch.cat([batch.state, torch.ones_like(batch.state)], -1)).sum(-1)
    error = (predicted - batch.outcome).square()[..., 0]
    least = (best - batch.outcome[..., 0]).square()
    # E[error - least] = E[(predicted - best)^2] >= 0 for any function of the samples before; the mean
    # over independent tasks may miss that by some standard errors.
    excess = error - least
    assert (excess.mean(1) > -6 * excess.std(1) / math.sqrt(n)).all()
    # A model that adapts well makes more of 10 samples than exact inference does of 7, and it knows the
    # prior: the error of guessing 0 is the exact one, up to a tenth.
    error, least = error.mean(1), least.mean(1)
    assert (error[:, 10] < least[:, 7]).all()
    assert (error[:, 0] < 1.1 * least[:, 0]).all()


@pytest.fixture(scope="module")
def contraction(folder) -> pd.DataFrame:
    return pd.read_parquet(folder / "contraction.parquet")


def test_contraction_has_every_model_task_count_with_and_without_drift(contraction):
    keys = ["drift", "model", "task", "samples"]
    assert len(contraction) == len(contraction.drop_duplicates(keys)) == 2 * 2 * 8 * len(COUNTS)
    assert set(contraction["drift"]) == {DRIFT, 0.0}
    assert set(contraction["samples"]) == set(COUNTS)
    assert np.isfinite(contraction.to_numpy(float)).all()
    # Before any sample the drift has not acted yet.
    first = contraction[contraction["samples"] == 0].set_index(keys).drop(columns="exact_sd_y")
    pd.testing.assert_frame_equal(first.loc[DRIFT], first.loc[0.0])


def mean_by_samples(contraction: pd.DataFrame, drift: float, column: str) -> pd.Series:
    rows = contraction[contraction["drift"] == drift]
    return rows.groupby("samples")[column].mean()


def test_belief_narrows_with_samples(contraction):
    for drift in (DRIFT, 0.0):
        early = mean_by_samples(contraction, drift, "sd_y").loc[:20]
        assert (early.diff().dropna() < 0).all()
    without = contraction[contraction["drift"] == 0.0].set_index(["model", "task", "samples"])
    # Sigma_n^-1 only ever grows without drift; float32 keeps some 1e-6 of it.
    for name in ("log_determinant", "trace", "smallest_eigenvalue"):
        assert (without[name].unstack().diff(axis=1).iloc[:, 1:] < 1e-5).all(axis=None)


def test_without_drift_the_belief_falls_like_one_over_n(contraction):
    """Sigma_n^-1 = Sigma_0^-1 + sum of H_i' H_i, whose mean tends to a constant."""
    trace = mean_by_samples(contraction, 0.0, "trace")
    # Sums of 500 independent terms of one sign vary by some 1 / sqrt(500) = 4 %; means over tasks by less.
    assert trace[1000] / trace[500] == pytest.approx(0.5, rel=0.1)
    assert trace[500] / trace[100] == pytest.approx(0.2, rel=0.2)


def test_with_drift_the_belief_stays_above_its_floor(contraction, folder):
    method, _ = load_ensemble(folder)
    assert isinstance(method, Kalman)
    # Other draws of the distribution that the stage drew from; half the bound is for a rarer sample there.
    lines = Lines(CONFIG["slope_sd"], CONFIG["intercept_sd"], CONFIG["x_range"])
    batch = draw(500, 1000, models=2, lines=lines).batch
    with torch.no_grad():
        _, H = method.whiten(*method.measure(batch.state, batch.action, batch.observed))
    information = torch.linalg.matrix_norm(H, ord=2).square().amax().item()
    # Sigma = (P^-1 + H'H)^-1 with P >= drift I.
    late = contraction[(contraction["drift"] == DRIFT) & (contraction["samples"] == 1000)]
    assert late["smallest_eigenvalue"].min() > 0.5 / (1 / DRIFT + information)
    with_drift = mean_by_samples(contraction, DRIFT, "trace")
    # Stationary, up to the samples that happened to come last; without drift it is half.
    assert with_drift[1000] / with_drift[500] == pytest.approx(1.0, rel=0.25)
    assert with_drift[1000] > 5 * mean_by_samples(contraction, 0.0, "trace")[1000]


def test_walkthrough_tables_agree_with_each_other(folder):
    belief, prediction, observed = (
        pd.read_parquet(folder / f"{name}.parquet") for name in ("belief", "prediction", "observed")
    )
    assert belief["samples"].tolist() == [0, 2, 10]
    assert observed["sample"].tolist() == list(range(1, 11))
    for row in belief.itertuples():
        covariance = np.array(
            [[row.covariance_1_1, row.covariance_1_2], [row.covariance_2_1, row.covariance_2_2]]
        )
        assert (np.linalg.eigvalsh(covariance) > 0).all()
    # All three panels show the one true line, on which the noiseless samples lie.
    first = prediction[prediction["samples"] == 0]
    slope, intercept = np.polyfit(first["x"], first["true_y"], 1)
    np.testing.assert_allclose(observed["true_y"], slope * observed["x"] + intercept, atol=1e-5)
    for n in (2, 10):
        same = prediction[prediction["samples"] == n]
        assert same["true_y"].tolist() == first["true_y"].tolist()
        # The exact curve, worked out again from the saved samples by least squares with the prior as rows.
        seen = observed[observed["sample"] <= n]
        X = np.concatenate([np.stack([seen["x"], np.ones(n)], 1) / math.sqrt(NOISE), np.eye(2)])
        y = np.concatenate([seen["observed_y"] / math.sqrt(NOISE), np.zeros(2)])
        w, b = np.linalg.lstsq(X, y, rcond=None)[0]
        np.testing.assert_allclose(same["exact_mean_y"], w * same["x"] + b, atol=1e-9)


def test_same_configuration_gives_the_same_tables(folder, tmp_path):
    short = CONFIG | {"training": CONFIG["training"] | {"steps": 5}, "tasks": 2}
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        regression.produce(Run(short, {}, tmp_path / name, 2))
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes(), path.name
