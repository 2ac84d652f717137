"""Forces on a sliding object beyond homogeneous dry friction.

A `Ground` holds one array per effect, with one row per instance of that effect and no rows where there is
none; all contributions add up. All forces are per unit of mass.

    board       gravity along a height field h and along slopes:  -g grad h,  -g (s + b (n.r - c) n)
    magnets     towards a point at d = q depth:  A q / (1 + q^2)^3 (1 - (q / 4)^2)^2 / 0.26 up to q = 4
    tethers     back to an anchor beyond a length:  -k (d - L) (1 + loss d')
    fans        along u, across a strip:  A u sech^2((n.r - c) / w) (1 + depth cos(2 pi f t + phase))
    drags       against the motion:  -A |v|^p
    curls       to the left of the motion:  A w_s tanh(w / w_s) |v|

Friction at a point is multiplied by exp(log friction at the point) (1 + rise(slip)) (1 + pull / g). The log
friction is the sum of waves and lanes, and `pull` is the normal acceleration that magnets add to g. Grooves
add the friction force -strength mu N A(angle) v / |v| at every point, with A(angle) = [[cos 2a, sin 2a], [sin
2a, -cos 2a]] and mu = sqrt(mu_x mu_y): Zmitrowicz's linear law.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from slapshot.arrays import GRAVITY, Array
from slapshot.lab.board import FLAT, gradient, value

MAGNET_RANGE = 4.0  # in depths
_MAGNET_PEAK = math.sqrt(0.2) / 1.2**3  # maximum of q / (1 + q^2)^3
_STILL = 1e-9  # m/s: below this speed the direction of motion is undefined
_CREEP = 1e-3  # m/s: MuJoCo lets an object at rest creep on a slope, which does not count as slip


def _none(columns: int) -> Array:
    return np.zeros((0, columns))


class Ground(NamedTuple):
    """Effects of the board and its surroundings on an object, one row per instance.

    Attributes:
        height: (n, 4) waves in m, see `board`.
        log_friction: (n, 4) waves, see `board`.
        slopes: (n, 6) rise along x and along y in m/m, bow b in 1/m, its direction n_x, n_y, and c in m.
        lanes: (n, 8) x, y (m) of the centre, cosine and sine of the direction, half length, half width,
            width of the edge (m), log friction within the lane.
        drags: (n, 2) A in m^(1-p) s^(p-2), p.
        fades: (n, 3) relative rise of friction at zero slip, slip at which it decays (m/s), exponent; 0 for
            a Lorentzian.
        grooves: (n, 2) strength, angle of largest friction (rad).
        curls: (n, 2) A, saturation w_s in rad/s.
        centres: (n, 3) position of the centre of mass in the object's frame (m), factor on the moment of
            inertia; at most one row.
        magnets: (n, 5) x, y, depth (m), A (m/s^2), normal acceleration straight above the magnet over A.
        tethers: (n, 5) x, y, length (m), k (1/s^2), loss (s/m).
        fans: (n, 8) u_x, u_y, c (m), w (m; 0 for everywhere), A (m/s^2), depth, f (Hz), phase (rad).
    """

    height: Array = FLAT
    log_friction: Array = FLAT
    slopes: Array = _none(6)
    lanes: Array = _none(8)
    drags: Array = _none(2)
    fades: Array = _none(3)
    grooves: Array = _none(2)
    curls: Array = _none(2)
    centres: Array = _none(3)
    magnets: Array = _none(5)
    tethers: Array = _none(5)
    fans: Array = _none(8)

    def plus(self, **rows: Array) -> "Ground":
        """A copy with further rows for some effects."""
        return self._replace(
            **{
                name: np.ascontiguousarray(np.concatenate([getattr(self, name), more]))
                for name, more in rows.items()
            }
        )


EVEN = Ground()


@njit(cache=True)
def push(ground, x, y, vx, vy, spin, time):  # type: ignore[no-untyped-def]
    """(ax, ay) in m/s^2 of all but the height field and friction; `time` in s from the hit's start."""
    ax = ay = 0.0
    for i in range(len(ground.slopes)):
        rise_x, rise_y, bow, nx, ny, middle = ground.slopes[i]
        bent = bow * (nx * x + ny * y - middle)
        ax -= GRAVITY * (rise_x + bent * nx)
        ay -= GRAVITY * (rise_y + bent * ny)
    for i in range(len(ground.magnets)):
        px, py, depth, strength, _ = ground.magnets[i]
        q = math.hypot(px - x, py - y) / depth
        if q < MAGNET_RANGE:
            # Divided by q, because the vector to the magnet has the length q depth.
            pull = strength / _MAGNET_PEAK / (1 + q**2) ** 3 * (1 - (q / MAGNET_RANGE) ** 2) ** 2
            ax += pull * (px - x) / depth
            ay += pull * (py - y) / depth
    for i in range(len(ground.tethers)):
        px, py, length, stiffness, loss = ground.tethers[i]
        dx, dy = x - px, y - py
        distance = math.hypot(dx, dy)
        if distance > length:
            pulled = stiffness * (distance - length)
            pulled *= max(0.0, 1 + loss * (vx * dx + vy * dy) / distance)
            ax -= pulled * dx / distance
            ay -= pulled * dy / distance
    for i in range(len(ground.fans)):
        ux, uy, middle, width, strength, depth, frequency, phase = ground.fans[i]
        blow = strength * (1 + depth * math.cos(2 * math.pi * frequency * time + phase))
        if width > 0:
            blow /= math.cosh((ux * y - uy * x - middle) / width) ** 2
        ax += blow * ux
        ay += blow * uy
    speed = math.hypot(vx, vy)
    if speed > _STILL:
        for i in range(len(ground.drags)):
            strength, power = ground.drags[i]
            held = strength * speed ** (power - 1)
            ax -= held * vx
            ay -= held * vy
        for i in range(len(ground.curls)):
            strength, most = ground.curls[i]
            turn = strength * most * math.tanh(spin / most)
            ax -= turn * vy
            ay += turn * vx
    return ax, ay


@njit(cache=True)
def log_place(ground, x, y):  # type: ignore[no-untyped-def]
    """Log friction at (x, y), relative to the object's own friction."""
    total = value(ground.log_friction, x, y)
    for i in range(len(ground.lanes)):
        px, py, cosine, sine, half_length, half_width, edge, depth = ground.lanes[i]
        along = cosine * (x - px) + sine * (y - py)
        across = cosine * (y - py) - sine * (x - px)
        total += depth * _inside(along, half_length, edge) * _inside(across, half_width, edge)
    return total


@njit(cache=True)
def _inside(q, half, edge):  # type: ignore[no-untyped-def]
    """Smooth window: near 1 for |q| < half, near 0 beyond, with edges of width `edge`."""
    return (math.tanh((q + half) / edge) - math.tanh((q - half) / edge)) / 2


@njit(cache=True)
def rise(ground, slip):  # type: ignore[no-untyped-def]
    """Factor on friction at a slip speed of `slip` m/s."""
    factor = 1.0
    for i in range(len(ground.fades)):
        share, speed, power = ground.fades[i]
        if power > 0:
            factor += share * math.exp(-((slip / speed) ** power))
        else:
            factor += share / (1 + (slip / speed) ** 2)
    return factor


@njit(cache=True)
def weight(ground, x, y):  # type: ignore[no-untyped-def]
    """Factor on the normal force of an object at (x, y)."""
    factor = 1.0
    for i in range(len(ground.magnets)):
        px, py, depth, strength, share = ground.magnets[i]
        q = math.hypot(px - x, py - y) / depth
        if q < MAGNET_RANGE:
            shape = (1 - (q / MAGNET_RANGE) ** 2) ** 2 / (1 + q**2) ** 3
            factor += strength * share * shape / GRAVITY
    return factor


@njit(cache=True)
def groove(ground, slip_x, slip_y):  # type: ignore[no-untyped-def]
    """(fx, fy) over mu N, friction of grooves at a point with slip velocity (slip_x, slip_y) in m/s."""
    fx = fy = 0.0
    slip = math.hypot(slip_x, slip_y)
    if slip > _STILL:
        for i in range(len(ground.grooves)):
            strength, angle = ground.grooves[i]
            cosine, sine = strength / slip * math.cos(2 * angle), strength / slip * math.sin(2 * angle)
            fx -= cosine * slip_x + sine * slip_y
            fy -= sine * slip_x - cosine * slip_y
    return fx, fy


@njit(cache=True)
def feel(ground, states, times, friction, forces, factors):  # type: ignore[no-untyped-def]
    """Surface forces and friction factors at the objects' centres, for the simulation of the whole arm.

    Args:
        ground: a Ground.
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s).
        times: (n,) s from the hit's start.
        friction: (n,) mu.
        forces: (n, 4) output: the slopes of the height field, and the other forces in m/s^2.
        factors: (n, 2) output: the local log friction, and the product of the other factors on friction.
    """
    for i in range(len(states)):
        x, y, _, vx, vy, spin = states[i]
        forces[i, 0], forces[i, 1] = gradient(ground.height, x, y)
        ax, ay = push(ground, x, y, vx, vy, spin, times[i])
        speed = math.hypot(vx, vy)
        fx, fy = groove(ground, vx, vy)
        held = friction[i] * GRAVITY * weight(ground, x, y) * speed / (speed + _CREEP)
        forces[i, 2], forces[i, 3] = ax + held * fx, ay + held * fy
        factors[i, 0] = log_place(ground, x, y)
        factors[i, 1] = rise(ground, speed) * weight(ground, x, y)
