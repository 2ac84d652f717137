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
# Near its rest a disc is integrated in steps of a share of the time that is left: spin and velocity die
# together, by ever faster laws, and spin the faster the larger torsional friction is.
SHARE, LEAST_SHARE, STIFF = 0.25, 0.02, 0.5
ENDS = 1 / 64  # of a step, where nothing is left
LONGEST = 12.0  # s
_NO_SLIP = 1e-9  # m/s: keeps s from 0


@dataclass(frozen=True)
class ActiveEffect:
    """An effect that acts on some of the hits.

    Attributes:
        effect: with at least one hook of the slide.
        rows: (k,) hits on which it acts.
        values: parameter -> (k,) values, or (), one for all of them.
    """

    effect: Effect
    rows: NDArray[np.int64]
    values: Mapping[str, Array]

    def of(self, keep: NDArray[np.bool_], place: NDArray[np.int64]) -> "ActiveEffect":
        """On those hits alone that are kept; `place` is where a hit stands afterwards."""
        mine = keep[self.rows]
        values = {n: v[mine] if v.ndim else v for n, v in self.values.items()}
        return ActiveEffect(self.effect, place[self.rows[mine]], values)


@dataclass(frozen=True)
class Tracks:
    """How n hits slide to rest.

    Attributes:
        times: (rows,) s since the launch.
        poses: (n, rows, 3) x, y (m) and yaw (rad), of the shape's centre; those after rest repeat the last.
        rests: (n, 2) m.
        durations: (n,) s.
    """

    times: Array
    poses: Array
    rests: Array
    durations: Array

    @property
    def places(self) -> Array:
        """(n, rows, 2) m."""
        return self.poses[..., :2]

    def at(self, times: Array) -> Array:
        """(n, frames, 2) m at `times` (n, frames) in s since the launch; before it, at the launch."""
        return self._at(times, self.places)

    def yaw_at(self, times: Array) -> Array:
        """(n, frames) rad, as `at`."""
        return self._at(times, self.poses[..., 2:])[..., 0]

    def _at(self, times: Array, values: Array) -> Array:
        step = self.times[1] - self.times[0]
        position = np.clip(times / step, 0, len(self.times) - 1 - 1e-9)
        low = position.astype(np.int64)
        share = (position - low)[..., None]
        hits = np.arange(len(values))[:, None]
        return np.asarray((1 - share) * values[hits, low] + share * values[hits, low + 1])


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
    poses, rests, durations = np.empty((count, rows, 3)), np.empty((count, 2)), np.empty(count)
    for mine, slid in ((~acted_on, _slide_freely), (acted_on, _slide)):
        if not mine.any():
            continue
        place = np.cumsum(mine) - 1
        law = SlideLaw.of(int(mine.sum()), friction[mine], radius, [act.of(mine, place) for act in acting])
        state = launches[mine].astype(float).T.copy()
        law.to_mass(state)
        poses[mine], rests[mine], durations[mine] = slid(law, state, order[mine], rows, step, longest)
    return Tracks(times, poses, rests, durations)


def _slide_freely(
    law: "SlideLaw", state: Array, order: Array, rows: int, step: float, longest: float
) -> tuple[Array, Array, Array]:
    """`_slide` where no effect acts: hit by hit, compiled, which takes a fraction of the time."""
    count = state.shape[1]
    poses, rests, durations = np.empty((count, rows, 3)), np.empty((count, 2)), np.empty(count)
    of = law.square, law.torsional, law.radius, law.inertia
    _slide_discs(state, *of, round(longest / step), step, poses, rests, durations)
    return poses, rests, durations


def _slide(
    law: "SlideLaw", state: Array, order: Array, rows: int, step: float, longest: float
) -> tuple[Array, Array, Array]:
    """Poses (n, rows, 3), rests (n, 2) in m and durations (n,) in s, of states (6, n) of the mass."""
    count = state.shape[1]
    poses = np.empty((count, rows, 3))
    filled = np.zeros(count, np.int64)
    alive, whole, began = np.arange(count), law, order
    times, states = np.empty(count), np.empty_like(state)  # from where discs are near their rest
    for k in range(round(longest / step)):
        if k % SAVE_EVERY == 0 and k // SAVE_EVERY < rows:
            row = k // SAVE_EVERY
            poses[alive, row] = law.shape_poses(state)
            filled[alive] = row + 1
        a = law.acceleration(state, k * step, order)
        near = law.share() * time_left(state, a, law.inertia) <= step
        if near.any():
            times[alive[near]], states[:, alive[near]] = k * step, state[:, near]
            alive, state, a, order = alive[~near], state[:, ~near], a[:, ~near], order[~near]
            law = law.rows(~near)
        if not len(alive):
            break
        state = advanced(law, state, a, step, (k + 1) * step, order)
    times[alive], states[:, alive] = longest, state
    ends, durations = _come_to_rest(whole, states, times, began, step, longest, poses, filled)
    late = np.arange(rows) >= filled[:, None]
    return np.where(late[..., None], ends[:, None], poses), ends[:, :2].copy(), durations


def _come_to_rest(
    law: "SlideLaw",
    state: Array,
    time: Array,
    order: Array,
    step: float,
    longest: float,
    poses: Array,
    filled: NDArray[np.int64],
) -> tuple[Array, Array]:
    """Poses at rest (n, 3) and durations (n,) in s, of discs near their rest; fills rows of poses on the way.

    Args:
        law: of the discs.
        state: (6, n).
        time: (n,) s, of the states.
        order: (n,).
        step: s, the longest one.
        longest: s.
        poses: (n, rows, 3), one every SAVE_EVERY steps.
        filled: (n,) how many of them are there.
    """
    ends, durations = np.empty((len(time), 3)), time.copy()
    alive, rows = np.arange(len(time)), poses.shape[1]
    while len(alive):
        a = law.acceleration(state, time, order)
        left = time_left(state, a, law.inertia)
        done = (left <= ENDS * step) | (time >= longest)
        if done.any():
            left = np.where(np.isfinite(left) & (time < longest), left, 0.0)
            hits = alive[done]
            ends[hits] = law.rows(done).shape_poses(_moved(state[:, done], left[done]))
            durations[hits] = time[done] + left[done]
            go = ~done
            alive, state, a, order, time, left = (
                alive[go], state[:, go], a[:, go], order[go], time[go], left[go]
            )  # fmt: skip
            law = law.rows(go)
        dt = np.minimum(step, law.share() * left)
        since = filled[alive] * SAVE_EVERY * step - time
        passed = (since < dt) & (filled[alive] < rows)
        if passed.any():
            t = since[passed]
            there = state[:, passed].copy()
            there[:3] += t * (there[3:] + t * a[:, passed] / 2)
            poses[alive[passed], filled[alive[passed]]] = law.rows(passed).shape_poses(there)
            filled[alive[passed]] += 1
        if len(alive):
            state = advanced(law, state, a, dt, time + dt, order)
            time = time + dt
    return ends, durations


def advanced(
    law: "SlideLaw", state: Array, a: Array, step: Array | float, time: Array | float, order: Array
) -> Array:
    """States (6, n) after a step of Heun's method; `time` is that of its end."""
    ahead = state.copy()
    ahead[:3] += step * state[3:]
    ahead[3:] += step * a
    b = law.acceleration(ahead, time, order)
    moved = state.copy()
    moved[:3] += step * (state[3:] + step * a / 2)
    moved[3:] += step * (a + b) / 2
    return moved


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
    law = SlideLaw.of(len(states), friction, radius, acting)
    state = states.astype(float).T.copy()
    law.to_mass(state)
    return law.acceleration(state, times, order)[:2].T


def _moved(state: Array, left: Array) -> Array:
    """Over the time that is left the object moves by half of what it would without slowing down."""
    return np.concatenate([state[:3] + state[3:] * left / 2, state[3:]])


def time_left(state: Array, a: Array, inertia: Array) -> Array:
    """(n,) s until the kinetic energy is spent at the present rate; infinite while it grows."""
    energy = state[3] ** 2 + state[4] ** 2 + inertia * state[5] ** 2
    rate = state[3] * a[0] + state[4] * a[1] + inertia * state[5] * a[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(rate < 0, -energy / rate, np.inf)
    return np.where(energy < _NO_SLIP**2, 0.0, left)


@dataclass
class SlideLaw:
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
    def of(cls, count: int, friction: Array, radius: float, acting: Sequence[ActiveEffect]) -> "SlideLaw":
        """Of some hits with friction (n, 3), mu_x, mu_y and torsional in m."""
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

    def rows(self, keep: NDArray[np.bool_]) -> "SlideLaw":
        """Of those hits alone that are kept."""
        place = np.cumsum(keep) - 1
        return SlideLaw(
            self.square[:, keep],
            self.torsional[keep],
            self.radius,
            self.inertia[keep],
            None if self.centre is None else self.centre[:, keep],
            [act.of(keep, place) for act in self.acting],
        )

    def share(self) -> Array:
        """(n,) of the time that is left, of a step near the rest."""
        return np.asarray(_share_of(self.square[0], self.square[2], self.torsional, self.inertia))

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

    def lever(self, yaw: Array) -> Array:
        """(2, n) m by which the centre of mass moves with a unit of yaw, about the shape's centre."""
        if self.centre is None:
            return np.zeros((2, len(yaw)))
        x, y = self._offset(yaw)
        return np.stack([-y, x])

    def to_mass(self, state: Array) -> None:
        """From the shape's centre to the centre of mass, in place."""
        if self.centre is None:
            return
        offset = self._offset(state[2])
        state[:2] += offset
        state[3] -= state[5] * offset[1]
        state[4] += state[5] * offset[0]

    def shape_poses(self, state: Array) -> Array:
        """(n, 3) x, y in m of the shape's centre, and yaw in rad."""
        if self.centre is None:
            return state[:3].T
        return np.concatenate([state[:2] - self._offset(state[2]), state[2:3]]).T

    def acceleration(self, state: Array, time: Array | float, order: Array) -> Array:
        """(3, n): m/s^2 along x and y, rad/s^2; `time` in s is (n,) or the same for all."""
        rubbed, pushed = self.parts(state, time, order)
        rubbed[:2] += pushed
        return rubbed

    def parts(self, state: Array, time: Array | float, order: Array) -> tuple[Array, Array]:
        """Of friction (3, n), and of pushes beside it (2, n) in m/s^2; as `acceleration`."""
        x, y, yaw, vx, vy, spin = state
        rubbed, pushed = self._dry(yaw, vx, vy, spin), np.zeros((2, len(x)))
        log_factor: Array | None = None
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
                for axis in range(2):
                    np.add.at(pushed[axis], rows, push[axis])
        if log_factor is not None:
            rubbed *= np.exp(log_factor)
        return rubbed, pushed

    def _dry(self, yaw: Array, vx: Array, vy: Array, spin: Array) -> Array:
        """(3, n) of dry friction with the nominal coefficients."""
        offset = np.zeros((2, 1)) if self.centre is None else self._offset(yaw)
        found = np.empty((3, len(vx)))
        law = self.square, self.torsional, self.radius, self.inertia
        _dry_friction(yaw, vx, vy, spin, *law, offset, found)
        return found


@njit(cache=True, nogil=True)
def _share_of(square_x, square_y, torsional, inertia):  # type: ignore[no-untyped-def]
    """Share of the time left, s / (mu g), that is STIFF of the time in which spin dies, i s / (mu_t^2 g)."""
    mu = np.sqrt((square_x + square_y) / 2)
    share = STIFF * inertia * mu / np.maximum(torsional, 1e-12)
    return np.maximum(np.minimum(share, SHARE), LEAST_SHARE)


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
def _slide_discs(state, square, torsional, radius, inertia, steps, step, poses, rests, durations):  # type: ignore[no-untyped-def]
    """Heun's method for discs on which nothing but dry friction acts; fills poses, rests and durations."""
    rows, longest = poses.shape[1], steps * step
    for k in range(state.shape[1]):
        tensor, mu, i = (square[0, k], square[1, k], square[2, k]), torsional[k], inertia[k]
        disc = radius, i, 0.0, 0.0
        share = _share_of(tensor[0], tensor[2], mu, i)
        x, y, yaw, vx, vy, spin = state[:, k]
        row, time, near, n = 0, 0.0, False, 0
        while True:
            ax, ay, twist = _of_disc(yaw, vx, vy, spin, tensor, mu, disc)
            energy = vx**2 + vy**2 + i * spin**2
            rate = vx * ax + vy * ay + i * spin * twist
            left = -energy / rate if rate < 0 else np.inf
            if energy < _NO_SLIP**2:
                left = 0.0
            if not near and n % SAVE_EVERY == 0 and row < rows:
                poses[k, row, 0], poses[k, row, 1], poses[k, row, 2] = x, y, yaw
                row += 1
            near = near or share * left <= step
            if (near and left <= ENDS * step) or time >= longest:
                if time >= longest:
                    left = 0.0
                break
            dt = min(step, share * left) if near else step
            t = row * SAVE_EVERY * step - time
            if near and t < dt and row < rows:
                poses[k, row, 0] = x + t * (vx + t * ax / 2)
                poses[k, row, 1] = y + t * (vy + t * ay / 2)
                poses[k, row, 2] = yaw + t * (spin + t * twist / 2)
                row += 1
            bx, by, turn = _of_disc(
                yaw + dt * spin, vx + dt * ax, vy + dt * ay, spin + dt * twist, tensor, mu, disc
            )
            x, y, yaw = (
                x + dt * (vx + dt * ax / 2),
                y + dt * (vy + dt * ay / 2),
                yaw + dt * (spin + dt * twist / 2),
            )
            vx, vy, spin = vx + dt * (ax + bx) / 2, vy + dt * (ay + by) / 2, spin + dt * (twist + turn) / 2
            n += 1
            time = time + dt if near else n * step
        x, y, yaw = x + vx * left / 2, y + vy * left / 2, yaw + spin * left / 2
        rests[k, 0], rests[k, 1], durations[k] = x, y, time + left
        poses[k, row:, 0], poses[k, row:, 1], poses[k, row:, 2] = x, y, yaw


def _squared_tensor(log_x: Array, log_y: Array, cross: Array) -> Array:
    """(3, n) entries xx, xy, yy of exp(2 S) for S = [[log_x, cross], [cross, log_y]]."""
    mean, half = log_x + log_y, log_x - log_y
    size = np.hypot(half, 2 * cross)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(size > 0, np.sinh(size) / size, 1.0)
    cosh, scale = np.cosh(size), np.exp(mean)
    return scale * np.stack([cosh + ratio * half, ratio * 2 * cross, cosh - ratio * half])
