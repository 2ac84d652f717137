"""A hop in closed form: what a striker has lifted flies, lands, and slides on.

In the air nothing acts along the plane, so that x, y and yaw go on at their rates for (u + w) / g, where u is
the speed at which the object rises from height h and w = sqrt(u^2 + 2 g h) that at which it comes down. The
plane stops it with a normal impulse m w, while friction bears at every instant the same share of the normal
force as in a slide: velocity and spin change as they would in w / g seconds of sliding.

MuJoCo's object bounces where it lands. Its friction bears the same share all the time, so that between two
bounces of speed u its velocity is off by mu u to either side, and it comes to rest at the same place.
"""

import numpy as np
from numba import njit

from slapshot.arrays import GRAVITY, Array
from slapshot.rollouts.slide import AT_REST, SPEED_CHANGE, SPIN_CHANGE, friction_acceleration


@njit(cache=True)
def _land(state, fall, friction, radius, inertia_per_mass):  # type: ignore[no-untyped-def]
    """Change the velocities of a state; Heun's method over the normal impulse per weight, in s."""
    _, _, yaw, vx, vy, spin = state
    mu_x, mu_y, mu_t = friction
    hardest = GRAVITY * max(mu_x, mu_y)
    twist = GRAVITY * mu_t**2 / inertia_per_mass
    left = fall / GRAVITY
    while left > 0:
        speed = np.sqrt(vx**2 + vy**2 + (radius * spin) ** 2)
        if speed < AT_REST:
            break
        pressing = np.sqrt((mu_x * vx) ** 2 + (mu_y * vy) ** 2 + (mu_t * spin) ** 2)
        step = min(left, SPEED_CHANGE * speed / hardest, SPIN_CHANGE * pressing / (twist + 1e-12))
        ax, ay, aw = friction_acceleration(yaw, vx, vy, spin, mu_x, mu_y, mu_t, radius, inertia_per_mass)
        bx, by, bw = friction_acceleration(
            yaw, vx + step * ax, vy + step * ay, spin + step * aw, mu_x, mu_y, mu_t, radius, inertia_per_mass
        )
        vx += step * (ax + bx) / 2
        vy += step * (ay + by) / 2
        spin += step * (aw + bw) / 2
        left -= step
    state[3:] = vx, vy, spin


@njit(cache=True)
def _land_all(states, falls, frictions, radius, inertia_per_mass):  # type: ignore[no-untyped-def]
    for i in range(len(states)):
        _land(states[i], falls[i], frictions[i], radius, inertia_per_mass)


def hop(states: Array, heights: Array, rising: Array, frictions: Array, radius: float) -> tuple[Array, Array]:
    """Let n flat solid discs come down.

    Args:
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s).
        heights: (n,) m above the plane; what is pressed into it counts as on it.
        rising: (n,) m/s.
        frictions: (n, 3) mu_x, mu_y, and torsional in m.
        radius: m.

    Returns:
        (n, 6) states once they are down, and (n,) the time in s that it took.
    """
    fall = np.sqrt(rising**2 + 2 * GRAVITY * np.maximum(heights, 0))
    times = (rising + fall) / GRAVITY
    landed = np.array(states, np.float64)
    landed[:, :3] += times[:, None] * landed[:, 3:]
    _land_all(landed, fall, np.ascontiguousarray(frictions, np.float64), radius, radius**2 / 2)
    return landed, times
