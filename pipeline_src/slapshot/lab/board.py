"""Smooth random fields over the board, for its height and for its friction.

    f(x, y) = sum_i a_i cos(kx_i x + ky_i y + phi_i)

with random wave vectors k_i, amplitudes a_i and phases phi_i. A field is an array (waves, 4) with rows
(kx, ky, a, phi), in rad/m, rad/m, the unit of f, rad; no rows make a field that is 0 everywhere.

A height field h in m exerts a force -m g grad h along the board on an object of mass m (slopes are of the
order of 1 %, so that cosines and the vertical motion are neglected). A field of log friction multiplies the
friction at (x, y) by exp(f).
"""

import math

import numpy as np
from numba import njit

from slapshot.arrays import Array

FLAT: Array = np.zeros((0, 4))


@njit(cache=True)
def value(field: Array, x: float, y: float) -> float:
    """f(x, y) of a field (waves, 4)."""
    total = 0.0
    for i in range(len(field)):
        kx, ky, amplitude, phase = field[i]
        total += amplitude * math.cos(kx * x + ky * y + phase)
    return total


@njit(cache=True)
def gradient(field: Array, x: float, y: float) -> tuple[float, float]:
    """(df/dx, df/dy) at (x, y) of a field (waves, 4), per m."""
    along_x = along_y = 0.0
    for i in range(len(field)):
        kx, ky, amplitude, phase = field[i]
        sine = amplitude * math.sin(kx * x + ky * y + phase)
        along_x -= kx * sine
        along_y -= ky * sine
    return along_x, along_y


def rms_value(field: Array) -> float:
    """Root mean square of f over the infinite plane, sqrt(sum a^2 / 2)."""
    return float(np.sqrt(np.sum(field[:, 2] ** 2) / 2))


def rms_slope(field: Array) -> float:
    """Root mean square of |grad f| over the infinite plane, sqrt(sum a^2 |k|^2 / 2), per m."""
    return float(np.sqrt(np.sum((field[:, 2] * _wave_numbers(field)) ** 2) / 2))


def draw_height(rms: float, wavelengths: tuple[float, float], waves: int, rng: np.random.Generator) -> Array:
    """Draw a (waves, 4) height field in m with rms slope `rms`; all waves contribute alike to the slope.

    Args:
        rms: slope, m/m.
        wavelengths: shortest and longest, m; drawn uniformly in between.
        waves: number of waves.
        rng: source of randomness.
    """
    field = _draw_waves(wavelengths, waves, rng)
    field[:, 2] /= _wave_numbers(field)
    field[:, 2] *= rms / rms_slope(field)
    return field


def draw_log_friction(
    rms: float, wavelengths: tuple[float, float], waves: int, rng: np.random.Generator
) -> Array:
    """Draw a (waves, 4) field of log friction with rms `rms`; arguments as in draw_height."""
    field = _draw_waves(wavelengths, waves, rng)
    field[:, 2] *= rms / rms_value(field)
    return field


def _wave_numbers(field: Array) -> Array:
    return np.hypot(field[:, 0], field[:, 1])


def _draw_waves(wavelengths: tuple[float, float], waves: int, rng: np.random.Generator) -> Array:
    """Waves in uniformly random directions with standard normal amplitudes."""
    number = 2 * np.pi / rng.uniform(*wavelengths, size=waves)
    direction, phase = rng.uniform(0, 2 * np.pi, size=(2, waves))
    amplitude = rng.normal(size=waves)
    return np.stack([number * np.cos(direction), number * np.sin(direction), amplitude, phase], axis=1)
