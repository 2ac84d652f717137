"""A hop in closed form: an object that the striker has lifted flies, lands, and slides on.

In flight no force acts along the plane, so that x, y and yaw change at constant rates for (u + w) / g, where
u is the vertical speed at height h and w = sqrt(u^2 + 2 g h) the speed of landing. The plane stops the object
with a normal impulse m w. Friction has at every instant the same ratio to the normal force as in a slide, so
that velocity and spin change as they would in w / g seconds of sliding.

In MuJoCo the object bounces when it lands, so that the normal force acts in impulses. Friction keeps the same
ratio to it: between two bounces of vertical speed u the velocity deviates by at most mu u to either side, and
the object comes to rest at the same place.
"""

import numpy as np
from numba import njit

from slapshot.arrays import GRAVITY, Array
from slapshot.rollouts.slide import AT_REST, SPEED_CHANGE, SPIN_CHANGE, friction_acceleration


@njit(cache=True)
def _land(state, fall, friction, radius, inertia_per_mass):  # type: ignore[no-untyped-def]
    """Change the velocities of a state in place, by Heun's method over the normal impulse per weight (s)."""
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
    """Let n flat solid discs land.

    Args:
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s).
        heights: (n,) m above the plane; an object that penetrates the plane counts as lying on it.
        rising: (n,) vertical speeds in m/s.
        frictions: (n, 3) mu_x, mu_y, and torsional in m.
        radius: m.

    Returns:
        (n, 6) states after landing, and (n,) the time in s that it took.
    """
    fall = np.sqrt(rising**2 + 2 * GRAVITY * np.maximum(heights, 0))
    times = (rising + fall) / GRAVITY
    landed = np.array(states, np.float64)
    landed[:, :3] += times[:, None] * landed[:, 3:]
    _land_all(landed, fall, np.ascontiguousarray(frictions, np.float64), radius, radius**2 / 2)
    return landed, times
