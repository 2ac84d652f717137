"""Hits by other physics than the diagnosis knows: a disc that rests on its whole face, in plain Runge-Kutta.

Nothing here is shared with the catalogue or with the lab. What acts is a function of the state that adds to
the force, or of place and time that scales friction.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from slapshot.calibration.slide_recordings import RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording

RATE, STEP, GRAVITY, MU = 50.0, 0.004, 9.81, 0.35
FACE = 24  # points that carry equal shares of the weight
NOISE = 0.003  # m
BEFORE = 0.4  # s that an object is seen at rest
SD_FRICTION = 0.03
START = np.array([0.55, 0.0])


@dataclass
class World:
    """What acts on n discs, beside dry friction.

    Attributes:
        push: (x, y, vx, vy, t) -> (n, 2) m/s^2.
        friction: (x, y, t, order) -> (n,) factor.
        offset: m from the middle of the disc to its centre of mass, along the disc's own axes.
        inertia: of the disc about its centre of mass over that of an even one.
        stamp: places (n, frames, 2) -> (n, frames) s by which a frame was taken later than it says.
        pushed: share of hits whose striker follows the object.
    """

    push: object = None
    friction: object = None
    offset: tuple = (0.0, 0.0)
    inertia: float = 1.0
    stamp: object = None
    pushed: float = 0.0


def hits(world, seed, count=100):
    """Recording of tracks with yaw."""
    rng = np.random.default_rng(seed)
    heading, speed = rng.uniform(-0.9, 0.9, count), rng.uniform(1.0, 2.3, count)
    start = START + rng.normal(0, 0.01, (count, 2))
    state = np.column_stack(
        [start, np.zeros(count), speed * np.cos(heading), speed * np.sin(heading), rng.normal(0, 1.5, count)]
    )
    # A blow through the middle of a disc whose mass lies beside it makes it spin.
    aside = world.offset[1] * np.cos(heading) - world.offset[0] * np.sin(heading)
    state[:, 5] += 0.5 * aside * speed / (world.inertia * RADIUS**2 / 2)
    order = np.arange(count) / (count - 1) - 0.5
    factor = np.exp(rng.normal(0, SD_FRICTION, count))
    follows = np.where(rng.uniform(size=count) < world.pushed, rng.uniform(0.25, 0.5, count), 0.0)
    angles, radii = np.arange(FACE) * 2.39996, RADIUS * np.sqrt((np.arange(FACE) + 0.5) / FACE)
    face = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)

    def slope(s, t):
        cosine, sine = np.cos(s[:, 2]), np.sin(s[:, 2])
        turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], axis=1)
        arm = (face - np.array(world.offset)) @ turn.transpose(0, 2, 1)
        slip = s[:, None, 3:5] + s[:, 5, None, None] * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
        # Points press so that the moment about the centre of mass vanishes.
        load = 1 + face @ np.array(world.offset) / (face[:, 0] ** 2).mean()
        share = -MU * GRAVITY * load[:, None] * slip / (np.linalg.norm(slip, axis=-1, keepdims=True) + 1e-4)
        scale = factor if world.friction is None else factor * world.friction(s[:, 0], s[:, 1], t, order)
        share *= scale[:, None, None] / FACE
        twist = (arm[..., 0] * share[..., 1] - arm[..., 1] * share[..., 0]).sum(1)
        force = share.sum(1)
        if world.push is not None:
            force = force + world.push(s[:, 0], s[:, 1], s[:, 3], s[:, 4], t)
        way = s[:, 3:5] / (np.linalg.norm(s[:, 3:5], axis=1, keepdims=True) + 1e-9)
        force = force + np.where(t < follows, 5.0, 0.0)[:, None] * way
        return np.column_stack([s[:, 3:], force, twist / (world.inertia * RADIUS**2 / 2)])

    rows = [state]
    for k in range(round(2.5 / STEP)):
        t = k * STEP
        a = slope(state, t)
        b = slope(state + STEP / 2 * a, t + STEP / 2)
        c = slope(state + STEP / 2 * b, t + STEP / 2)
        d = slope(state + STEP * c, t + STEP)
        moved = state + STEP / 6 * (a + 2 * b + 2 * c + d)
        # Dry friction stops an object; it does not turn it round.
        slow = np.linalg.norm(state[:, 3:5], axis=1) < MU * GRAVITY * STEP
        held = slow & (np.linalg.norm(force_without_friction(world, state, t), axis=1) < MU * GRAVITY)
        moved[held, :3], moved[held, 3:] = state[held, :3], 0.0
        state = moved
        rows.append(state)
    path = np.stack(rows, axis=1)
    cosine, sine = np.cos(path[..., 2]), np.sin(path[..., 2])
    middle = path[..., :2] - np.stack(
        [
            cosine * world.offset[0] - sine * world.offset[1],
            sine * world.offset[0] + cosine * world.offset[1],
        ],
        axis=-1,
    )
    return _seen(world, rng, middle, path[..., 2])


def force_without_friction(world, state, t):
    if world.push is None:
        return np.zeros((len(state), 2))
    return world.push(state[:, 0], state[:, 1], state[:, 3], state[:, 4], t)


def _seen(world, rng, middle, yaw):
    count = len(middle)
    made = recording(rng, hits=count)
    times = np.arange(0, BEFORE + (middle.shape[1] - 1) * STEP + 0.4, 1 / RATE)
    tables = []
    for i in range(count):

        def at(t, i=i):
            row = np.clip((t - BEFORE) / STEP, 0, middle.shape[1] - 1)
            steps = np.arange(middle.shape[1])
            return np.stack([np.interp(row, steps, middle[i, :, k]) for k in range(2)], axis=-1), np.interp(
                row, steps, yaw[i]
            )

        places, turned = at(times)
        if world.stamp is not None:
            places, turned = at(times + world.stamp(places))
        places = places + rng.normal(0, NOISE, places.shape)
        table = {"hit": i, "t": times, "x": places[:, 0], "y": places[:, 1], "yaw": turned}
        tables.append(pd.DataFrame(table))
    table = made.hits.copy()
    table["rest_x"], table["rest_y"] = middle[:, -1, 0], middle[:, -1, 1]
    table["start_x"], table["start_y"] = START
    return replace(made, hits=table, tracks=pd.concat(tables, ignore_index=True))
