"""Bounds on the contact phase: when a striker can first touch an object at rest, and when it no longer can.

The striker is approximated by the infinite plane of its face, so that contact cannot occur before the plane
reaches the object.
"""

import math

import numpy as np
from numba import njit

from slapshot.arrays import GRAVITY


@njit(cache=True)
def first_within(swings, first, window, striker, normal, middles, half_thickness, radius, height, reach):  # type: ignore[no-untyped-def]
    """(n,) first ticks at which the face is nearer than `reach` to an upright cylinder, or the window's last.

    Args:
        swings: (n,) of each hit.
        first: (s,) tick at which a swing's window begins.
        window: ticks.
        striker: (s, ticks, 3) m.
        normal: (s, ticks, 3) of the face.
        middles: (n, 3) m, of the cylinders.
        half_thickness: m, from the striker's middle to its face.
        radius: m, of the cylinders.
        height: m, of the cylinders.
        reach: m.
    """
    found = np.empty(len(swings), np.int64)
    for i in range(len(swings)):
        swing = swings[i]
        tick = first[swing]
        last = first[swing] + window - 1
        while tick < last:
            nx, ny, nz = normal[swing, tick]
            px, py, pz = striker[swing, tick]
            ahead = nx * (middles[i, 0] - px) + ny * (middles[i, 1] - py) + nz * (middles[i, 2] - pz)
            # Half extent of the cylinder along the face's normal.
            towards = radius * math.hypot(nx, ny) + height / 2 * abs(nz)
            if ahead - half_thickness - towards < reach:
                break
            tick += 1
        found[i] = tick
    return found


@njit(cache=True)
def has_parted(swings, ticks, period, striker, normal, states, falling, friction, distance, margin, every):  # type: ignore[no-untyped-def]
    """(n,) whether the striker stays farther than `margin` from an object for the rest of its swing.

    The object is assumed to be decelerated by the largest possible friction throughout, and at once by the
    friction impulse of its landing. The striker is assumed to move as it did without an object; a tilted
    striker is approximated by the position of its centre.

    Args:
        swings: (n,) of each hit.
        ticks: (n,) current ticks.
        period: s, of a tick.
        striker: (s, ticks, 3) m.
        normal: (s, ticks, 3) of the face.
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) of objects now.
        falling: (n,) m/s, downward speed.
        friction: (n,) largest coefficient of friction in any direction.
        distance: m, from the middle of the striker to that of an object in contact.
        margin: m.
        every: ticks between the future times that are checked.
    """
    parted = np.ones(len(swings), np.bool_)
    end = striker.shape[1] - 1
    for i in range(len(swings)):
        swing = swings[i]
        x, y, _, vx, vy, _ = states[i]
        speed = math.hypot(vx, vy)
        hardest = GRAVITY * friction[i]
        left = max(speed - friction[i] * max(falling[i], 0.0), 0.0)
        tick = min(ticks[i], end)
        while parted[i]:
            # The object may still move after the end of the swing, so that its rest point is checked, too.
            time = min((tick - ticks[i]) * period, left / hardest) if tick <= end else left / hardest
            moved = (left * time - hardest * time**2 / 2) / max(speed, 1e-9)
            at = min(tick, end)
            nx, ny = normal[swing, at, 0], normal[swing, at, 1]
            ahead = nx * (x + vx * moved - striker[swing, at, 0]) + ny * (
                y + vy * moved - striker[swing, at, 1]
            )
            parted[i] = ahead / math.hypot(nx, ny) - distance > margin
            if tick > end:
                break
            tick = min(tick + every, end) if tick < end else end + 1
    return parted
