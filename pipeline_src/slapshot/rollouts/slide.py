"""The planar slide: a flat object with velocity and spin comes to rest under anisotropic dry friction.

The object is supported at three points of its rim, as MuJoCo's cylinder on a plane is, each carrying a third
of the weight N. Friction at a point with slip velocity (vx, vy) and spin w maximises dissipation within the
elliptic cone (fx/mu_x)^2 + (fy/mu_y)^2 + (m/mu_t)^2 <= N^2:

    f_j = -N mu_j^2 v_j / sqrt(mu_x^2 vx^2 + mu_y^2 vy^2 + mu_t^2 w^2)

There is no rolling friction, because an object that stays flat does not roll. This is the textbook law that
MuJoCo's elliptic cones approximate. MuJoCo's soft contacts make a sliding object hop by micrometres, so that
spin decays sooner and anisotropy bends paths less, which moves rest points by 1 to 3 % of the slide's length,
and by up to 6 % for short slides.
"""

import numpy as np
from numba import njit

from slapshot.arrays import GRAVITY, Array

POINTS = 3
_COSINE, _SINE = np.cos(2 * np.pi / POINTS), np.sin(2 * np.pi / POINTS)  # from a point to the next
MAX_STEP = 2e-3  # s
SPEED_CHANGE = 0.05  # largest share of its speed that the object may lose per step
SPIN_CHANGE = 0.5  # largest share of its spin per step; at 2 the sign of the spin would alternate for ever
AT_REST = 1e-3  # m/s: the remaining slide is shorter than a micrometre


@njit(cache=True)
def friction_acceleration(yaw, vx, vy, spin, mu_x, mu_y, mu_t, radius, inertia_per_mass):  # type: ignore[no-untyped-def]
    """Acceleration by friction (m/s^2, m/s^2, rad/s^2) at velocities in m/s and spin in rad/s."""
    ax = ay = twist = 0.0
    rx, ry = radius * np.cos(yaw), radius * np.sin(yaw)
    for _ in range(POINTS):
        sx, sy = vx - spin * ry, vy + spin * rx
        norm = np.sqrt((mu_x * sx) ** 2 + (mu_y * sy) ** 2 + (mu_t * spin) ** 2) + 1e-12
        share = GRAVITY / POINTS / norm
        fx, fy = -share * mu_x**2 * sx, -share * mu_y**2 * sy
        ax += fx
        ay += fy
        twist += rx * fy - ry * fx - share * mu_t**2 * spin
        rx, ry = _COSINE * rx - _SINE * ry, _SINE * rx + _COSINE * ry
    return ax, ay, twist / inertia_per_mass


@njit(cache=True)
def _slide_one(state, friction, radius, inertia_per_mass, period, track):  # type: ignore[no-untyped-def]
    """Slide one object by Heun's method with a step that shrinks with its speed.

    Fills `track` every `period` seconds.
    """
    x, y, yaw, vx, vy, spin = state
    mu_x, mu_y, mu_t = friction
    hardest = GRAVITY * max(mu_x, mu_y)
    twist = GRAVITY * mu_t**2 / inertia_per_mass
    time, row = 0.0, 0
    while True:
        speed = np.sqrt(vx**2 + vy**2 + (radius * spin) ** 2)
        if speed < AT_REST:
            break
        # A spin that is slow relative to the speed decays at the rate twist / pressing.
        pressing = np.sqrt((mu_x * vx) ** 2 + (mu_y * vy) ** 2 + (mu_t * spin) ** 2)
        step = min(MAX_STEP, SPEED_CHANGE * speed / hardest, SPIN_CHANGE * pressing / (twist + 1e-12))
        ax, ay, aw = friction_acceleration(yaw, vx, vy, spin, mu_x, mu_y, mu_t, radius, inertia_per_mass)
        bx, by, bw = friction_acceleration(
            yaw + step * spin, vx + step * ax, vy + step * ay, spin + step * aw,
            mu_x, mu_y, mu_t, radius, inertia_per_mass,
        )  # fmt: skip
        while row < len(track) and row * period < time + step:
            part = row * period - time
            track[row, 0] = x + part * (vx + part * ax / 2)
            track[row, 1] = y + part * (vy + part * ay / 2)
            track[row, 2] = yaw + part * (spin + part * aw / 2)
            row += 1
        x += step * (vx + step * ax / 2)
        y += step * (vy + step * ay / 2)
        yaw += step * (spin + step * aw / 2)
        vx += step * (ax + bx) / 2
        vy += step * (ay + by) / 2
        spin += step * (aw + bw) / 2
        time += step
    while row < len(track):
        track[row] = (x, y, yaw)
        row += 1
    return x, y, yaw, time


@njit(cache=True)
def _slide_all(states, frictions, radius, inertia_per_mass, period, tracks, rests):  # type: ignore[no-untyped-def]
    for i in range(len(states)):
        rests[i] = _slide_one(states[i], frictions[i], radius, inertia_per_mass, period, tracks[i])


def slide(
    states: Array, frictions: Array, radius: float, period: float = 0.01, samples: int = 0
) -> tuple[Array, Array]:
    """Slide n flat solid discs to rest.

    Args:
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s).
        frictions: (n, 3) mu_x, mu_y, and torsional in m.
        radius: m.
        period: s between samples of the tracks.
        samples: rows of a track; those after rest repeat the rest pose.

    Returns:
        (n, 4): x, y, yaw at rest and the time in s it took; (n, samples, 3) tracks of x, y, yaw.
    """
    rests = np.empty((len(states), 4))
    tracks = np.empty((len(states), samples, 3))
    _slide_all(
        np.ascontiguousarray(states, np.float64),
        np.ascontiguousarray(frictions, np.float64),
        radius,
        radius**2 / 2,
        period,
        tracks,
        rests,
    )
    return rests, tracks
