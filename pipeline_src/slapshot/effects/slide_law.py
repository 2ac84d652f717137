"""The slide of flat discs with effects: many hits at once, each with values of its own.

Without effects this is the law of `slapshot.rollouts.slide`: dry friction of maximum dissipation at POINTS
points of the rim. It is written for arrays of hits rather than for one hit, so that an effect is a plain
function of arrays and thousands of perturbed hits cost little more than one.

With the friction tensor M = exp(S), S = [[log mu_x, c], [c, log mu_y]], and load N a point with slip v and
spin w bears the force and the torque of maximum dissipation in |(M^-1 f, m / mu_t)| <= N:

    f = -N M M v / s,  m = -N mu_t^2 w / s,  s = sqrt(|M v|^2 + (mu_t w)^2)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from slapshot.arrays import GRAVITY, Array
from slapshot.effects.effect import Effect, SlideState

POINTS = 4  # a quarter of the rim apart
STEP = 2e-3  # s; longer ones tell little of how a spin dies, on which fits of slow boxes hang
SAVE_EVERY = 5  # steps between rows of a track
LONGEST = 12.0  # s
_NO_SLIP = 1e-9  # m/s: keeps s from 0


@dataclass(frozen=True)
class ActiveEffect:
    """An effect that acts on some of the hits.

    Attributes:
        effect: with at least one hook of the slide.
        rows: (k,) hits on which it acts.
        values: parameter -> (k,) values.
    """

    effect: Effect
    rows: NDArray[np.int64]
    values: Mapping[str, Array]

    def of(self, keep: NDArray[np.bool_], place: NDArray[np.int64]) -> "ActiveEffect":
        """On those hits alone that are kept; `place` is where a hit stands afterwards."""
        mine = keep[self.rows]
        values = {name: value[mine] for name, value in self.values.items()}
        return ActiveEffect(self.effect, place[self.rows[mine]], values)


@dataclass(frozen=True)
class Tracks:
    """How n hits slide to rest.

    Attributes:
        times: (rows,) s since the launch.
        places: (n, rows, 2) m, of the shape's centre; those after rest repeat the last place.
        rests: (n, 2) m.
        durations: (n,) s.
    """

    times: Array
    places: Array
    rests: Array
    durations: Array

    def at(self, times: Array) -> Array:
        """(n, frames, 2) m at `times` (n, frames) in s since the launch; before it, at the launch."""
        step = self.times[1] - self.times[0]
        position = np.clip(times / step, 0, len(self.times) - 1 - 1e-9)
        low = position.astype(np.int64)
        share = (position - low)[..., None]
        hits = np.arange(len(self.places))[:, None]
        return (1 - share) * self.places[hits, low] + share * self.places[hits, low + 1]


def slide(
    launches: Array,
    friction: Array,
    radius: float,
    duration: float,
    acting: Sequence[ActiveEffect] = (),
    order: Array | None = None,
    step: float = STEP,
    longest: float = LONGEST,
) -> Tracks:
    """Slide n flat solid discs to rest.

    Args:
        launches: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) of the shape's centre.
        friction: (n, 3) mu_x, mu_y, and torsional in m.
        radius: m; without effects the moment of inertia is m radius^2 / 2.
        duration: s that the tracks last.
        acting: effects and the hits that they act on.
        order: (n,) place in the recording, -1/2 to 1/2; None for 0.
        step: s, of Heun's method.
        longest: s after which discs that still move, as in a hollow, are left where they are.
    """
    count = len(launches)
    rows = int(np.ceil(duration / (step * SAVE_EVERY))) + 2
    times = np.linspace(0, (rows - 1) * step * SAVE_EVERY, rows)
    order = np.zeros(count) if order is None else order
    acted_on = np.zeros(count, bool)
    for act in acting:
        acted_on[act.rows] = True
    places, rests, durations = np.empty((count, rows, 2)), np.empty((count, 2)), np.empty(count)
    for mine, slid in ((~acted_on, _slide_freely), (acted_on, _slide)):
        if not mine.any():
            continue
        place = np.cumsum(mine) - 1
        law = _Law.of(int(mine.sum()), friction[mine], radius, [act.of(mine, place) for act in acting])
        state = launches[mine].astype(float).T.copy()
        law.to_mass(state)
        places[mine], rests[mine], durations[mine] = slid(law, state, order[mine], rows, step, longest)
    return Tracks(times, places, rests, durations)


def _slide_freely(
    law: "_Law", state: Array, order: Array, rows: int, step: float, longest: float
) -> tuple[Array, Array, Array]:
    """`_slide` where no effect acts: hit by hit, compiled, which takes a fraction of the time."""
    count = state.shape[1]
    places, rests, durations = np.empty((count, rows, 2)), np.empty((count, 2)), np.empty(count)
    of = law.square, law.torsional, law.radius, law.inertia
    _slide_discs(state, *of, round(longest / step), step, places, rests, durations)
    return places, rests, durations


def _slide(
    law: "_Law", state: Array, order: Array, rows: int, step: float, longest: float
) -> tuple[Array, Array, Array]:
    """Places (n, rows, 2) in m, rests (n, 2) in m, durations (n,) in s, of states (6, n) of the mass."""
    count = state.shape[1]
    places = np.empty((count, rows, 2))
    filled = np.zeros(count, np.int64)
    rests, durations = np.full((count, 2), np.nan), np.full(count, longest)
    alive = np.arange(count)
    for k in range(round(longest / step)):
        if k % SAVE_EVERY == 0 and k // SAVE_EVERY < rows:
            row = k // SAVE_EVERY
            places[alive, row] = law.shape_places(state)
            filled[alive] = row + 1
        a = law.acceleration(state, k * step, order)
        left = _time_left(state, a, law.inertia)
        done = left <= step
        if done.any():
            hits, ended = alive[done], _moved(state[:, done], left[done])
            rests[hits] = law.rows(done).shape_places(ended)
            durations[hits] = k * step + left[done]
            alive, state, a, order = alive[~done], state[:, ~done], a[:, ~done], order[~done]
            law = law.rows(~done)
        if not len(alive):
            break
        ahead = state.copy()
        ahead[:3] += step * state[3:]
        ahead[3:] += step * a
        b = law.acceleration(ahead, (k + 1) * step, order)
        state[:3] += step * (state[3:] + step * a / 2)
        state[3:] += step * (a + b) / 2
    rests[alive] = law.shape_places(state)
    late = np.arange(rows) >= filled[:, None]
    return np.where(late[..., None], rests[:, None], places), rests, durations


def accelerations(
    states: Array, friction: Array, radius: float, acting: Sequence[ActiveEffect], times: Array, order: Array
) -> Array:
    """(n, 2) m/s^2 of n discs.

    Args:
        states: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) of the shape's centre.
        friction: (n, 3) mu_x, mu_y, and torsional in m.
        radius: m.
        acting: effects and the discs that they act on.
        times: (n,) s since the launch.
        order: (n,) place in the recording, -1/2 to 1/2.
    """
    law = _Law.of(len(states), friction, radius, acting)
    state = states.astype(float).T.copy()
    law.to_mass(state)
    return law.acceleration(state, times, order)[:2].T


def _moved(state: Array, left: Array) -> Array:
    """Over the time that is left the object moves by half of what it would without slowing down."""
    return np.concatenate([state[:3] + state[3:] * left / 2, state[3:]])


def _time_left(state: Array, a: Array, inertia: Array) -> Array:
    """(n,) s until the kinetic energy is spent at the present rate; infinite while it grows."""
    energy = state[3] ** 2 + state[4] ** 2 + inertia * state[5] ** 2
    rate = state[3] * a[0] + state[4] * a[1] + inertia * state[5] * a[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(rate < 0, -energy / rate, np.inf)
    return np.where(energy < _NO_SLIP**2, 0.0, left)


@dataclass
class _Law:
    """Friction and effects of n hits.

    Attributes:
        square: (3, n) entries xx, xy, yy of M M.
        torsional: (n,) mu_t^2 in m^2.
        radius: m.
        inertia: (n,) m^2, moment of inertia about the centre of mass over the mass.
        centre: (2, n) m from the shape's centre to the centre of mass at yaw 0; None for 0.
        acting: effects.
    """

    square: Array
    torsional: Array
    radius: float
    inertia: Array
    centre: Array | None
    acting: Sequence[ActiveEffect]

    @classmethod
    def of(cls, count: int, friction: Array, radius: float, acting: Sequence[ActiveEffect]) -> "_Law":
        cross = np.zeros(count)
        centre = np.zeros((2, count))
        log_inertia = np.full(count, np.log(radius**2 / 2))
        moved = False
        for act in acting:
            part = act.effect.cross_anisotropy(act.values)
            if part is not None:
                np.add.at(cross, act.rows, part)
            factor = act.effect.log_inertia(act.values)
            if factor is not None:
                np.add.at(log_inertia, act.rows, factor)
            offset = act.effect.centre_offset(act.values)
            if offset is not None:
                moved = True
                for axis in range(2):
                    np.add.at(centre[axis], act.rows, offset[axis])
        square = _squared_tensor(np.log(friction[:, 0]), np.log(friction[:, 1]), cross)
        return cls(
            square, friction[:, 2] ** 2, radius, np.exp(log_inertia), centre if moved else None, acting
        )

    def rows(self, keep: NDArray[np.bool_]) -> "_Law":
        place = np.cumsum(keep) - 1
        return _Law(
            self.square[:, keep],
            self.torsional[keep],
            self.radius,
            self.inertia[keep],
            None if self.centre is None else self.centre[:, keep],
            [act.of(keep, place) for act in self.acting],
        )

    def _offset(self, yaw: Array) -> Array:
        """(2, n) m from the shape's centre to the centre of mass."""
        assert self.centre is not None
        cosine, sine = np.cos(yaw), np.sin(yaw)
        return np.stack(
            [
                cosine * self.centre[0] - sine * self.centre[1],
                sine * self.centre[0] + cosine * self.centre[1],
            ]
        )

    def to_mass(self, state: Array) -> None:
        """From the shape's centre to the centre of mass, in place."""
        if self.centre is None:
            return
        offset = self._offset(state[2])
        state[:2] += offset
        state[3] -= state[5] * offset[1]
        state[4] += state[5] * offset[0]

    def shape_places(self, state: Array) -> Array:
        """(n, 2) m of the shape's centre."""
        if self.centre is None:
            return state[:2].T
        return (state[:2] - self._offset(state[2])).T

    def acceleration(self, state: Array, time: Array | float, order: Array) -> Array:
        """(3, n): m/s^2 along x and y, rad/s^2; `time` in s is (n,) or the same for all."""
        x, y, yaw, vx, vy, spin = state
        ax, ay, twist = self._dry(yaw, vx, vy, spin)
        log_factor: Array | None = None
        pushes: list[tuple[NDArray[np.int64], Array, Array]] = []
        for act in self.acting:
            rows = act.rows
            if not len(rows):
                continue
            now = np.broadcast_to(time, x.shape)[rows]
            part = SlideState(x[rows], y[rows], yaw[rows], vx[rows], vy[rows], spin[rows], now, order[rows])
            factor = act.effect.log_friction(act.values, part)
            if factor is not None:
                log_factor = np.zeros_like(x) if log_factor is None else log_factor
                np.add.at(log_factor, rows, factor)
            push = act.effect.accelerate(act.values, part)
            if push is not None:
                pushes.append((rows, push[0], push[1]))
        if log_factor is not None:
            factor = np.exp(log_factor)
            ax, ay, twist = ax * factor, ay * factor, twist * factor
        for rows, px, py in pushes:
            np.add.at(ax, rows, px)
            np.add.at(ay, rows, py)
        return np.stack([ax, ay, twist])

    def _dry(self, yaw: Array, vx: Array, vy: Array, spin: Array) -> tuple[Array, Array, Array]:
        """Dry friction with the nominal coefficients."""
        offset = np.zeros((2, 1)) if self.centre is None else self._offset(yaw)
        found = np.empty((3, len(vx)))
        law = self.square, self.torsional, self.radius, self.inertia
        _dry_friction(yaw, vx, vy, spin, *law, offset, found)
        return found[0], found[1], found[2]


@njit(cache=True, nogil=True)
def _dry_friction(yaw, vx, vy, spin, square, torsional, radius, inertia, offset, found):  # type: ignore[no-untyped-def]
    """Fills (3, n): m/s^2, m/s^2, rad/s^2; `offset` (2, n) m to the centre of mass, (2, 1) for none."""
    for k in range(len(vx)):
        cx, cy = (offset[0, k], offset[1, k]) if offset.shape[1] > 1 else (0.0, 0.0)
        tensor = square[0, k], square[1, k], square[2, k]
        disc = radius, inertia[k], cx, cy
        found[0, k], found[1, k], found[2, k] = _of_disc(
            yaw[k], vx[k], vy[k], spin[k], tensor, torsional[k], disc
        )


@njit(cache=True, nogil=True)
def _of_disc(yaw, vx, vy, spin, tensor, torsional, disc):  # type: ignore[no-untyped-def]
    """Of one disc; `disc` holds radius, inertia over mass, and the centre of mass."""
    radius, inertia, cx, cy = disc
    ax = ay = twist = 0.0
    rx, ry = radius * np.cos(yaw), radius * np.sin(yaw)
    for _ in range(POINTS):
        # Loads on a ring of points whose moment about the centre of mass vanishes.
        load = GRAVITY / POINTS * (1 + 2 * (rx * cx + ry * cy) / radius**2)
        arm_x, arm_y = rx - cx, ry - cy
        sx, sy = vx - spin * arm_y, vy + spin * arm_x
        px = tensor[0] * sx + tensor[1] * sy
        py = tensor[1] * sx + tensor[2] * sy
        share = load / (np.sqrt(sx * px + sy * py + torsional * spin**2) + _NO_SLIP)
        ax -= share * px
        ay -= share * py
        twist -= share * (arm_x * py - arm_y * px + torsional * spin)
        rx, ry = -ry, rx  # the next quarter of the rim
    return ax, ay, twist / inertia


@njit(cache=True, nogil=True)
def _slide_discs(state, square, torsional, radius, inertia, steps, step, places, rests, durations):  # type: ignore[no-untyped-def]
    """Heun's method for discs on which nothing but dry friction acts; fills places, rests and durations."""
    for k in range(state.shape[1]):
        tensor, mu, i = (square[0, k], square[1, k], square[2, k]), torsional[k], inertia[k]
        disc = radius, i, 0.0, 0.0
        x, y, yaw, vx, vy, spin = state[:, k]
        rows, row, left, taken = places.shape[1], 0, step, 0
        for n in range(steps):
            if n % SAVE_EVERY == 0 and row < rows:
                places[k, row, 0], places[k, row, 1] = x, y
                row += 1
            ax, ay, twist = _of_disc(yaw, vx, vy, spin, tensor, mu, disc)
            energy = vx**2 + vy**2 + i * spin**2
            rate = vx * ax + vy * ay + i * spin * twist
            left = -energy / rate if rate < 0 else np.inf
            if energy < _NO_SLIP**2:
                left = 0.0
            taken = n
            if left <= step:
                x, y = x + vx * left / 2, y + vy * left / 2
                break
            bx, by, turn = _of_disc(
                yaw + step * spin, vx + step * ax, vy + step * ay, spin + step * twist, tensor, mu, disc
            )
            x, y, yaw = (
                x + step * (vx + step * ax / 2),
                y + step * (vy + step * ay / 2),
                yaw + step * (spin + step * twist / 2),
            )
            vx, vy, spin = (
                vx + step * (ax + bx) / 2,
                vy + step * (ay + by) / 2,
                spin + step * (twist + turn) / 2,
            )
        else:
            left, taken = 0.0, steps
        rests[k, 0], rests[k, 1], durations[k] = x, y, taken * step + left
        places[k, row:, 0], places[k, row:, 1] = x, y


def _squared_tensor(log_x: Array, log_y: Array, cross: Array) -> Array:
    """(3, n) entries xx, xy, yy of exp(2 S) for S = [[log_x, cross], [cross, log_y]]."""
    mean, half = log_x + log_y, log_x - log_y
    size = np.hypot(half, 2 * cross)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(size > 0, np.sinh(size) / size, 1.0)
    cosh, scale = np.cosh(size), np.exp(mean)
    return scale * np.stack([cosh + ratio * half, ratio * 2 * cross, cosh - ratio * half])
