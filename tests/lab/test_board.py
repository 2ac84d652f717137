import numpy as np
import pytest
from slapshot.lab.board import (
    draw_height,
    draw_log_friction,
    gradient,
    rms_slope,
    rms_value,
    value,
)

WAVELENGTHS = (0.3, 1.5)


@pytest.fixture
def field() -> np.ndarray:
    return draw_height(0.01, WAVELENGTHS, 24, np.random.default_rng(0))


def test_gradient_against_finite_differences(field):
    # Central differences are off by eps^2 / 6 times the third derivative, plus rounding.
    eps = 1e-4
    number = np.hypot(field[:, 0], field[:, 1])
    amplitude = np.abs(field[:, 2])
    tolerance = eps**2 / 6 * amplitude @ number**3 + 4e-16 * amplitude.sum() / eps
    for x, y in np.random.default_rng(1).uniform(-2, 2, (50, 2)):
        along_x = (value(field, x + eps, y) - value(field, x - eps, y)) / (2 * eps)
        along_y = (value(field, x, y + eps) - value(field, x, y - eps)) / (2 * eps)
        assert gradient(field, x, y) == pytest.approx((along_x, along_y), abs=tolerance)


@pytest.mark.parametrize("seed", range(3))
def test_fields_are_as_rough_as_asked(seed):
    rng = np.random.default_rng(seed)
    height = draw_height(0.012, WAVELENGTHS, 24, rng)
    friction = draw_log_friction(0.05, WAVELENGTHS, 12, rng)
    assert rms_slope(height) == pytest.approx(0.012)
    assert rms_value(friction) == pytest.approx(0.05)
    for field in (height, friction):
        wavelength = 2 * np.pi / np.hypot(field[:, 0], field[:, 1])
        assert WAVELENGTHS[0] <= wavelength.min() <= wavelength.max() <= WAVELENGTHS[1]
    # The closed forms are means over a plane without end: points all over a large one agree with them.
    places = rng.uniform(-1e4, 1e4, (4000, 2))
    steepness = np.array([np.sum(np.square(gradient(height, x, y))) for x, y in places])
    heights = np.array([value(friction, x, y) ** 2 for x, y in places])
    for squares, rms in ((steepness, 0.012), (heights, 0.05)):
        assert squares.mean() == pytest.approx(rms**2, abs=6 * np.sqrt(squares.var() / len(places)))


def test_no_waves_make_an_even_board():
    assert value(np.zeros((0, 4)), 0.3, 0.2) == 0.0
    assert gradient(np.zeros((0, 4)), 0.3, 0.2) == (0.0, 0.0)
