"""The lab's slide: a disc with velocity and spin slides to rest under dry friction and surface forces.

The disc is supported by a ring of n points at its rim, each of which carries N = m g / n. At a point with
slip velocity (vx, vy) and spin w, friction maximises dissipation within the ellipsoid (fx/mu_x)^2 +
(fy/mu_y)^2 + (torque/mu_t)^2 <= (c N)^2, where c is the surface's local factor on friction:

    fx = -c N mu_x^2 vx / s,  fy = -c N mu_y^2 vy / s,  torque = -c N mu_t^2 w / s,
    s = sqrt(mu_x^2 vx^2 + mu_y^2 vy^2 + mu_t^2 w^2)

The board's height field adds -m g grad h, and `surface` defines the other forces. Where the centre of mass is
offset by o from the disc's centre, a point at r from the centre carries N (1 + 2 r.o / R^2), so that the
loads have no moment about the centre of mass. Integrated by the midpoint rule with a fixed step; all forces
are per unit of mass.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from slapshot.arrays import GRAVITY, Array
from slapshot.errors import InputError
from slapshot.lab.board import gradient
from slapshot.lab.surface import EVEN, Ground, groove, log_place, push, rise, weight

POINTS = 12
# s. On all surfaces of the lab, rest points differ by less than 0.05 mm from those at a tenth of this step;
# the camera measures rest points to 0.8 mm.
STEP = 2e-3
LONGEST = 30.0  # s; an object that comes to rest at all does so earlier
_NO_SLIP = 1e-12  # m/s: avoids a division by zero where a point does not slip


@dataclass(frozen=True)
class Slide:
    """The slide of a disc to rest.

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
    ground: Ground = EVEN,
    start: float = 0.0,
    step: float = STEP,
    points: int = POINTS,
) -> Slide:
    """Slide a solid disc to rest.

    Args:
        state: (6,) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) of the disc's middle.
        friction: mu_x, mu_y, and mu_t in m.
        radius: m; the moment of inertia is m radius^2 / 2.
        period: s, between rows of the track.
        ground: surface forces and friction.
        start: s from the hit's start to this state.
        step: s, integration step.
        points: number of points of the ring.

    Raises:
        InputError: the disc does not come to rest, because the other forces exceed friction.
    """
    track = np.empty((int(LONGEST / period) + 2, 3))
    x, y, yaw, duration, rows = _run(
        np.ascontiguousarray(state, np.float64), *friction, radius, points, ground,
        start, step, period, track,
    )  # fmt: skip
    if duration >= LONGEST:
        raise InputError(
            f"lab: an object still slides after {LONGEST:g} s; lower lab.board.rms_slope or what else "
            "pushes (lab.concealed), or raise the friction of lab.objects"
        )
    return Slide(np.array([x, y, yaw]), duration, track[:rows].copy())


@njit(cache=True, nogil=True)
def _acceleration(x, y, yaw, vx, vy, spin, time, ox, oy, inertia, mu_x, mu_y, mu_t, radius, points, ground):  # type: ignore[no-untyped-def]
    """ax, ay in m/s^2 and the spin's rate in rad/s^2, of a disc whose centre of mass is at x, y."""
    slope_x, slope_y = gradient(ground.height, x, y)
    ax, ay, torque = -GRAVITY * slope_x, -GRAVITY * slope_y, 0.0
    px, py = push(ground, x, y, vx, vy, spin, time)
    ax, ay = ax + px, ay + py
    pressed = weight(ground, x, y)
    mean = math.sqrt(mu_x * mu_y)
    # Checked once, outside of the loop that takes most of the time.
    patchy = len(ground.log_friction) + len(ground.lanes) > 0
    fading, grooved = len(ground.fades) > 0, len(ground.grooves) > 0
    for i in range(points):
        angle = yaw + 2 * math.pi * i / points
        rx, ry = radius * math.cos(angle), radius * math.sin(angle)
        load = pressed * (1 + 2 * (rx * ox + ry * oy) / radius**2)
        rx, ry = rx - ox, ry - oy
        slip_x, slip_y = vx - spin * ry, vy + spin * rx
        s = math.sqrt((mu_x * slip_x) ** 2 + (mu_y * slip_y) ** 2 + (mu_t * spin) ** 2)
        if fading:
            load *= rise(ground, math.hypot(slip_x, slip_y))
        place = math.exp(log_place(ground, x + rx, y + ry)) if patchy else 1.0
        share = GRAVITY / points / (s + _NO_SLIP) * place * load
        fx, fy = -share * mu_x**2 * slip_x, -share * mu_y**2 * slip_y
        if grooved:
            gx, gy = groove(ground, slip_x, slip_y)
            held = GRAVITY / points * place * load * mean
            fx, fy = fx + held * gx, fy + held * gy
        ax += fx
        ay += fy
        torque += rx * fy - ry * fx - share * mu_t**2 * spin
    return ax, ay, torque / (inertia * radius**2 / 2)


@njit(cache=True, nogil=True)
def _holds(x, y, time, mu_x, mu_y, ground):  # type: ignore[no-untyped-def]
    """Whether static friction holds a disc at rest at (x, y)."""
    if mu_x <= 0 or mu_y <= 0:
        return False
    slope_x, slope_y = gradient(ground.height, x, y)
    px, py = push(ground, x, y, 0.0, 0.0, 0.0, time)
    along_x, along_y = slope_x - px / GRAVITY, slope_y - py / GRAVITY
    held = math.exp(log_place(ground, x, y)) * rise(ground, 0.0) * weight(ground, x, y)
    return (along_x / mu_x) ** 2 + (along_y / mu_y) ** 2 < held**2


@njit(cache=True, nogil=True)
def _run(state, mu_x, mu_y, mu_t, radius, points, ground, start, step, period, track):  # type: ignore[no-untyped-def]
    """Fill `track`; return x, y, yaw at rest, the duration and the number of rows filled."""
    x, y, yaw, vx, vy, spin = state
    # From here on x, y, vx, vy are those of the centre of mass; (ox, oy) is its offset from the disc's
    # centre.
    out_x, out_y, inertia = 0.0, 0.0, 1.0
    for i in range(len(ground.centres)):
        out_x, out_y, inertia = ground.centres[i]
    ox, oy = _turned(out_x, out_y, yaw)
    x, y, vx, vy = x + ox, y + oy, vx - spin * oy, vy + spin * ox
    track[0] = (x - ox, y - oy, yaw)
    rows, time, taken = 1, 0.0, 0
    while time < LONGEST:
        ox, oy = _turned(out_x, out_y, yaw)
        ax, ay, aw = _acceleration(
            x, y, yaw, vx, vy, spin, start + time, ox, oy, inertia,
            mu_x, mu_y, mu_t, radius, points, ground,
        )  # fmt: skip
        # Twice the kinetic energy per mass, and half its time derivative. Under constant deceleration the
        # disc stops after `left` seconds.
        energy = vx**2 + vy**2 + inertia * radius**2 / 2 * spin**2
        rate = vx * ax + vy * ay + inertia * radius**2 / 2 * spin * aw
        left = 0.0 if energy < _NO_SLIP**2 else -energy / rate if rate < 0 else math.inf
        # A further step would reverse the direction of friction. On a slope the disc stays only where static
        # friction holds it: elsewhere it has merely stopped for an instant before it slides back down.
        if left <= step and _holds(x, y, start + time, mu_x, mu_y, ground):
            # During `left` the disc moves by half of the distance that it would without deceleration.
            x, y, yaw = x + vx * left / 2, y + vy * left / 2, yaw + spin * left / 2
            ox, oy = _turned(out_x, out_y, yaw)
            return x - ox, y - oy, yaw, time + left, rows
        half = step / 2
        mx, my, mw = vx + half * ax, vy + half * ay, spin + half * aw
        ox, oy = _turned(out_x, out_y, yaw + half * spin)
        ax, ay, aw = _acceleration(
            x + half * vx, y + half * vy, yaw + half * spin, mx, my, mw, start + time + half, ox, oy, inertia,
            mu_x, mu_y, mu_t, radius, points, ground,
        )  # fmt: skip
        taken += 1
        time = taken * step
        while rows < len(track) and rows * period <= time:
            part = rows * period - (time - step)
            share = part / step  # interpolates along the parabola from here to the step's end
            ux, uy, uw = vx + share * (mx - vx), vy + share * (my - vy), spin + share * (mw - spin)
            ox, oy = _turned(out_x, out_y, yaw + part * uw)
            track[rows] = (x + part * ux - ox, y + part * uy - oy, yaw + part * uw)
            rows += 1
        x, y, yaw = x + step * mx, y + step * my, yaw + step * mw
        vx, vy, spin = vx + step * ax, vy + step * ay, spin + step * aw
    ox, oy = _turned(out_x, out_y, yaw)
    return x - ox, y - oy, yaw, time, rows


@njit(cache=True, nogil=True)
def _turned(out_x, out_y, yaw):  # type: ignore[no-untyped-def]
    """Vector from the disc's centre to the centre of mass in the world frame."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return cosine * out_x - sine * out_y, sine * out_x + cosine * out_y
