"""Intervals on data whose distribution is known, and principal components against an eigendecomposition."""

import math

import numpy as np
import pytest
from scipy import stats
from slapshot.statistics import bootstrap, principal_components

# --- Bootstrap


def mean(table: np.ndarray) -> float:
    return float(table.mean())


@pytest.mark.parametrize(
    ("models", "tasks", "model_sd", "task_sd"),
    [(2, 40, 0.0, 1.0), (40, 2, 1.0, 0.0), (40, 40, 1.0, 1.0)],
    ids=["tasks differ", "models differ", "both differ"],
)
def test_an_interval_covers_the_truth_as_often_as_it_says(models, tasks, model_sd, task_sd):
    """Resampling n values has (n - 1) / n of the variance of their mean, so it covers as |t| < 1.96 of it."""
    rng = np.random.default_rng(0)
    repeats, covered = 500, 0
    for seed in range(repeats):
        table = rng.normal(0, model_sd, (models, 1)) + rng.normal(0, task_sd, (1, tasks))
        interval = bootstrap(mean, table, draws=200, seed=seed)
        assert interval.low <= interval.value == table.mean() <= interval.high
        covered += interval.low < 0 < interval.high
    expected = 1 - 2 * stats.t.sf(1.96 * math.sqrt(39 / 40), 39)  # 0.94
    # Four binomial standard errors; a percentile of 200 draws costs up to 0.005.
    error = 4 * math.sqrt(expected * (1 - expected) / repeats) + 0.005
    assert covered / repeats == pytest.approx(expected, abs=error)


def test_width_is_that_of_the_standard_error():
    rng = np.random.default_rng(1)
    tasks, draws = 200, 4000
    values = rng.normal(3, 2, (1, tasks))
    interval = bootstrap(mean, values, draws=draws)
    assert interval.value == pytest.approx(values.mean())
    error = values.std() / math.sqrt(tasks)
    # A 2.5 % quantile of n draws: sqrt(p (1 - p) / n) over the density at 1.96.
    spread = math.sqrt(0.025 * 0.975 / draws) / stats.norm.pdf(1.96)
    assert (interval.high - interval.value) / error == pytest.approx(1.96, abs=5 * spread + 0.05)
    assert (interval.value - interval.low) / error == pytest.approx(1.96, abs=5 * spread + 0.05)


def test_what_two_tables_share_cancels():
    """Models and tasks are drawn once for all tables."""
    rng = np.random.default_rng(2)
    first = rng.lognormal(0, 2, (4, 30, 5))
    interval = bootstrap(lambda a, b: float(b.mean() / a.mean()), first, 1.3 * first, draws=300)
    assert (interval.low, interval.high) == pytest.approx((1.3, 1.3))
    alone = bootstrap(mean, first, draws=300)
    assert alone.high > 1.2 * alone.low


def test_tables_of_other_tasks_are_resampled_apart_and_share_their_models():
    """The difference of two means over other tasks has the sum of both variances; models cancel."""
    rng = np.random.default_rng(3)
    model = rng.normal(0, 100, (6, 1))
    first, second = (model + rng.normal(0, sd, (1, n)) for sd, n in ((1.0, 80), (2.0, 300)))
    interval = bootstrap(lambda a, b: float(a.mean() - b.mean()), first, second, tasks=(0, 1), draws=4000)
    error = math.sqrt(first[0].var() / 80 + second[0].var() / 300)
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * error, rel=0.1)


def test_models_and_tasks_are_resampled_apart():
    """Every model meets every task: a draw is a table of rows and columns, not of single cells."""
    table = 10.0 * np.arange(3)[:, None] + np.arange(4)
    seen = []
    bootstrap(lambda a: seen.append(a) or 0.0, table, draws=200)
    models, tasks = set(), set()
    for draw in seen[:-1]:  # the last is the table itself
        assert draw.shape == table.shape
        assert (draw - draw[:, :1] == draw[:1] - draw[0, 0]).all()
        models.add(tuple(draw[:, 0] // 10))
        tasks.add(tuple(draw[0] % 10))
    # Of 27 and 256 possible ones.
    assert len(models) > 20
    assert len(tasks) > 90
    assert (seen[-1] == table).all()


def test_the_seed_decides():
    table = np.random.default_rng(3).normal(size=(4, 20))
    first, again, other = (bootstrap(mean, table, draws=50, seed=seed) for seed in (0, 0, 1))
    assert first == again
    assert (first.low, first.high) != (other.low, other.high)


# --- Principal components


def test_components_are_eigenvectors_of_the_covariance():
    rng = np.random.default_rng(4)
    vectors = rng.normal(size=(200, 5)) @ rng.normal(size=(5, 5)) + rng.normal(size=5)
    found = principal_components(vectors, 3)
    variances, axes = np.linalg.eigh(np.cov(vectors.T))
    variances, axes = variances[::-1], axes.T[::-1]
    assert found.explained == pytest.approx(variances[:3] / variances.sum())
    assert np.abs((found.axes * axes[:3]).sum(1)) == pytest.approx(1)
    assert found.axes @ found.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    scores = found.apply(vectors)
    assert scores.mean(0) == pytest.approx(0, abs=1e-12)
    assert np.cov(scores.T) == pytest.approx(np.diag(variances[:3]), abs=1e-10)


def test_vectors_in_a_plane_are_found_again_from_two_components():
    rng = np.random.default_rng(5)
    plane, centre = rng.normal(size=(2, 6)), rng.normal(size=6)
    vectors = rng.normal(size=(4, 25, 2)) @ plane + centre
    found = principal_components(vectors.reshape(-1, 6), 2)
    assert found.explained.sum() == pytest.approx(1)
    scores = found.apply(vectors)
    assert scores.shape == (4, 25, 2)
    assert scores @ found.axes + found.mean == pytest.approx(vectors)


def test_orientation_follows_the_guides_and_changes_nothing_else():
    rng = np.random.default_rng(6)
    vectors = rng.normal(size=(100, 3)) * [3.0, 2.0, 1.0]
    found = principal_components(vectors, 2)
    first, second = found.apply(vectors).T
    noise = rng.normal(0, 0.5, 100)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        turned = found.oriented(vectors, signs[0] * first + noise, signs[1] * second + noise)
        assert turned.axes == pytest.approx(found.axes * np.array(signs)[:, None])
        assert (turned.mean == found.mean).all()
        assert (turned.explained == found.explained).all()


def test_a_component_without_a_guide_stays_as_it_is():
    vectors = np.random.default_rng(7).normal(size=(50, 4))
    found = principal_components(vectors, 3)
    turned = found.oriented(vectors, -found.apply(vectors)[:, 0])
    assert turned.axes == pytest.approx(found.axes * np.array([-1, 1, 1])[:, None])
