"""The lab's slide: a disc with velocity and spin comes to rest on an uneven board with dry friction.

The disc stands on a ring of n points at its rim, each of which carries N = m g / n. At a point with slip
velocity (vx, vy) and spin w friction has maximum dissipation in the ellipsoid (fx/mu_x)^2 + (fy/mu_y)^2 +
(torque/mu_t)^2 <= (c N)^2, where c = exp(log friction field) at that point:

    fx = -c N mu_x^2 vx / s,  fy = -c N mu_y^2 vy / s,  torque = -c N mu_t^2 w / s,
    s = sqrt(mu_x^2 vx^2 + mu_y^2 vy^2 + mu_t^2 w^2)

The board adds -m g grad h. Midpoint rule with a fixed step; per unit of mass throughout.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slapshot.errors import InputError
from slapshot.lab.board import FLAT, gradient, value

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
POINTS = 12
STEP = 2e-4  # s
LONGEST = 30.0  # s; nothing that comes to rest slides this long
_NO_SLIP = 1e-12  # m/s: keeps s from 0 where a point does not slip


@dataclass(frozen=True)
class Slide:
    """How a disc came to rest.

    Attributes:
        rest: (3,) x, y (m), yaw (rad).
        duration: s.
        track: (rows, 3) x, y, yaw every period from 0 on, the last row at or before rest.
    """

    rest: Array
    duration: float
    track: Array


def slide(
    state: Array,
    friction: tuple[float, float, float],
    radius: float,
    period: float,
    height: Array = FLAT,
    log_friction: Array = FLAT,
    step: float = STEP,
    points: int = POINTS,
) -> Slide:
    """Slide a solid disc to rest.

    Args:
        state: (6,) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s).
        friction: mu_x, mu_y, and mu_t in m.
        radius: m; the moment of inertia is m radius^2 / 2.
        period: s, between rows of the track.
        height: field (waves, 4) of the board's height in m, see `board`.
        log_friction: field (waves, 4) of log friction.
        step: s, of integration.
        points: on the ring.

    Raises:
        InputError: the disc does not come to rest, because the board is steeper than friction holds.
    """
    track = np.empty((int(LONGEST / period) + 2, 3))
    x, y, yaw, duration, rows = _run(
        np.ascontiguousarray(state, np.float64), *friction, radius, points, height, log_friction,
        step, period, track,
    )  # fmt: skip
    if duration >= LONGEST:
        raise InputError(
            f"lab: an object still slides after {LONGEST:g} s; lower lab.board.rms_slope or raise "
            "the friction of lab.objects"
        )
    return Slide(np.array([x, y, yaw]), duration, track[:rows].copy())


@njit(cache=True)
def _acceleration(x, y, yaw, vx, vy, spin, mu_x, mu_y, mu_t, radius, points, height, log_friction):  # type: ignore[no-untyped-def]
    """ax, ay in m/s^2 and the spin's rate in rad/s^2."""
    slope_x, slope_y = gradient(height, x, y)
    ax, ay, torque = -GRAVITY * slope_x, -GRAVITY * slope_y, 0.0
    for i in range(points):
        angle = yaw + 2 * math.pi * i / points
        rx, ry = radius * math.cos(angle), radius * math.sin(angle)
        slip_x, slip_y = vx - spin * ry, vy + spin * rx
        s = math.sqrt((mu_x * slip_x) ** 2 + (mu_y * slip_y) ** 2 + (mu_t * spin) ** 2)
        share = GRAVITY / points / (s + _NO_SLIP) * math.exp(value(log_friction, x + rx, y + ry))
        fx, fy = -share * mu_x**2 * slip_x, -share * mu_y**2 * slip_y
        ax += fx
        ay += fy
        torque += rx * fy - ry * fx - share * mu_t**2 * spin
    return ax, ay, torque / (radius**2 / 2)


@njit(cache=True)
def _holds(x, y, mu_x, mu_y, height, log_friction):  # type: ignore[no-untyped-def]
    """Whether friction holds a disc that rests at (x, y)."""
    slope_x, slope_y = gradient(height, x, y)
    steep = (slope_x / mu_x) ** 2 + (slope_y / mu_y) ** 2 if mu_x > 0 and mu_y > 0 else math.inf
    return steep < math.exp(2 * value(log_friction, x, y))


@njit(cache=True)
def _run(state, mu_x, mu_y, mu_t, radius, points, height, log_friction, step, period, track):  # type: ignore[no-untyped-def]
    """Fill `track`; return x, y, yaw at rest, the duration and the number of rows filled."""
    x, y, yaw, vx, vy, spin = state
    track[0] = (x, y, yaw)
    rows, time, taken = 1, 0.0, 0
    while time < LONGEST:
        ax, ay, aw = _acceleration(
            x, y, yaw, vx, vy, spin, mu_x, mu_y, mu_t, radius, points, height, log_friction
        )
        # Twice the kinetic energy, and half its rate: at this rate it lasts for `left` seconds.
        energy = vx**2 + vy**2 + radius**2 / 2 * spin**2
        rate = vx * ax + vy * ay + radius**2 / 2 * spin * aw
        left = 0.0 if energy < _NO_SLIP**2 else -energy / rate if rate < 0 else math.inf
        # A further step would turn the friction round. On a slope the disc stays only where it is
        # held: elsewhere it has merely stopped for an instant, between uphill and downhill.
        if left <= step and _holds(x, y, mu_x, mu_y, height, log_friction):
            # Over `left` the disc still moves, by half of what it would without slowing down.
            x, y, yaw = x + vx * left / 2, y + vy * left / 2, yaw + spin * left / 2
            return x, y, yaw, time + left, rows
        half = step / 2
        mx, my, mw = vx + half * ax, vy + half * ay, spin + half * aw
        ax, ay, aw = _acceleration(
            x + half * vx, y + half * vy, yaw + half * spin, mx, my, mw,
            mu_x, mu_y, mu_t, radius, points, height, log_friction,
        )  # fmt: skip
        taken += 1
        time = taken * step
        while rows < len(track) and rows * period <= time:
            part = rows * period - (time - step)
            track[rows] = (x + part * mx, y + part * my, yaw + part * mw)
            rows += 1
        x, y, yaw = x + step * mx, y + step * my, yaw + step * mw
        vx, vy, spin = vx + step * ax, vy + step * ay, spin + step * aw
    return x, y, yaw, time, rows
