import numpy as np
import pytest
from scipy import stats
from slapshot.scenes.randomisation import draw_conditions, draw_start_errors, middle_condition

COUNT = 20_000


@pytest.fixture(scope="module")
def spec(hockey_config):
    return hockey_config.randomisation


def test_distributions_are_those_of_table_two(spec):
    drawn = draw_conditions(spec, COUNT, np.random.default_rng(0))
    for name, low, high in (
        ("mass", 0.01, 0.1),
        ("friction_x", 0.15, 0.95),
        ("friction_torsional", 0.001, 0.05),
        ("friction_rolling", 0.01, 0.3),
    ):
        assert stats.kstest(drawn[name], "uniform", args=(low, high - low)).pvalue > 1e-4
    ratio = drawn["friction_y"] / drawn["friction_x"]
    assert stats.kstest(ratio, "uniform", args=(0.7, 0.6)).pvalue > 1e-4
    # Drawn apart: a correlation beyond six standard errors would be a shared draw.
    assert abs(np.corrcoef(ratio, drawn["friction_x"])[0, 1]) < 6 / np.sqrt(COUNT)
    errors = draw_start_errors(spec.start_error, COUNT, np.random.default_rng(1))
    assert stats.kstest(errors.ravel(), "norm", args=(0, 0.02)).pvalue > 1e-4
    assert abs(np.corrcoef(errors.T)[0, 1]) < 6 / np.sqrt(COUNT)


def test_same_seed_same_conditions(spec):
    first, second = (draw_conditions(spec, 5, np.random.default_rng(7)) for _ in range(2))
    for name in first:
        assert np.array_equal(first[name], second[name])


def test_middle_condition_is_the_mean(spec):
    middle = middle_condition(spec)
    assert middle["mass"] == pytest.approx(0.055)
    assert middle["friction_y"] == pytest.approx(middle["friction_x"])
