"""How slides change with parameters of what acts on them, for any number of parameters at once.

About one slide of each hit, differences of its state z (place, yaw and their rates) obey linear equations,

    dz/dt = F(t) z + (0, g_j(t)),   F = ((0, 1), (da/dplace, da/drates)),

with g_j the change of the acceleration by parameter j where the slide passes. They are integrated in the
steps of the slide itself by the trapezoidal rule, which stays stable where spin dies within a step. One such
slide serves all parameters, where differences of slides need one slide each.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numba import njit

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, SlideState
from slapshot.effects.slide_law import ENDS, ActiveEffect, SlideLaw, advanced, time_left

HITS_AT_ONCE = 20  # so that what acts on all their steps stays within the memory of one core
_SMALL = 1e-6  # m, rad, m/s, rad/s, of differences of accelerations by the state
_SHARE = 1e-3  # of a parameter's step, of those by a parameter

Values = Mapping[str, Array]  # parameter -> () value, the same for all hits


@dataclass(frozen=True)
class ByParameter:
    """A derivative that is asked for.

    Attributes:
        effect: that acts on slides, though not on where the centre of mass is or on the inertia.
        parameter: of it.
        step: of differences, where the effect is not linear in it.
    """

    effect: Effect
    parameter: str
    step: float


@dataclass(frozen=True)
class Slides:
    """Slides of n hits, of which derivatives are taken.

    Attributes:
        launches: (n, 6) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) of the shape's centre.
        friction: (n, 3) mu_x, mu_y, and torsional in m.
        radius: m.
        order: (n,) place in the recording, -1/2 to 1/2.
        effects: that act on slides, by name.
        values: of those that do act.
    """

    launches: Array
    friction: Array
    radius: float
    order: Array
    effects: Mapping[str, Effect]
    values: Mapping[str, Values]

    def derivatives(self, by: Sequence[ByParameter], moments: Array, step: float, threads: int = 1) -> Array:
        """(n, frames, 2, p) of the shape's centre in m at moments (n, frames) in s since the launch."""
        found = np.zeros((*moments.shape, 2, len(by)))

        def fill(first: int) -> None:
            some = slice(first, first + HITS_AT_ONCE)
            found[some] = _Linear(self._of(some), moments[some], step).at(by)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(fill, range(0, len(moments), HITS_AT_ONCE)))
        return found

    def _of(self, some: slice) -> "Slides":
        launches, friction, order = (of[some] for of in (self.launches, self.friction, self.order))
        return replace(self, launches=launches, friction=friction, order=order)

    def law(self, times: int, changed: tuple[Effect, Values] | None = None) -> SlideLaw:
        """Of every hit at some times, one hit after another; with other values of one effect."""
        rows = np.arange(len(self.launches) * times)
        values = {name: (self.effects[name], of) for name, of in self.values.items()}
        if changed is not None:
            values[changed[0].name] = changed
        acting = [ActiveEffect(effect, rows, of) for effect, of in values.values()]
        return SlideLaw.of(len(rows), np.repeat(self.friction, times, axis=0), self.radius, acting)


class _Linear:
    """Linear equations about the slides of some hits."""

    def __init__(self, slides: Slides, moments: Array, step: float) -> None:
        self._slides, self._moments = slides, moments
        law = slides.law(1)
        self._times, states = _path(law, slides, float(moments.max(initial=0.0)), step)
        count, self._steps = self._times.shape
        self._t = self._times.ravel()
        self._x = states.reshape(-1, 6).T.copy()
        self._order = np.repeat(slides.order, self._steps)
        self._law = slides.law(self._steps)
        self._rubbed, pushed = self._law.parts(self._x, self._t, self._order)
        self._a = self._rubbed.copy()
        self._a[:2] += pushed
        slopes = np.empty((len(self._t), 3, 6))
        for i in range(6):
            moved = self._x.copy()
            moved[i] += _SMALL
            slopes[:, :, i] = (self._law.acceleration(moved, self._t, self._order) - self._a).T / _SMALL
        self._slopes = slopes.reshape(count, self._steps, 3, 6)

    def at(self, by: Sequence[ByParameter]) -> Array:
        """(n, frames, 2, p) derivatives of places."""
        count, frames = self._moments.shape
        found = np.zeros((count, frames, 2, len(by)))
        first = 0
        # Where the centre of mass lies aside, that of the shape moves with yaw, too.
        lever = self._law.lever(self._x[2]).reshape(2, count, self._steps)
        for _, group in groupby(by, key=lambda one: one.effect.name):
            some = list(group)
            pushed = self._pushed(some).reshape(3, len(some), count, self._steps)
            last = first + len(some)
            for i in range(count):
                force = np.ascontiguousarray(pushed[:, :, i].transpose(2, 0, 1))
                moved = _integrated(self._times[i], self._slopes[i], force)
                places = moved[:, :2] - lever[:, i].T[:, :, None] * moved[:, 2:3]
                found[i, :, :, first:last] = _between(self._times[i], places, self._moments[i])
            first = last
        return found

    def _pushed(self, by: Sequence[ByParameter]) -> Array:
        """(3, p, n steps) change of accelerations by parameters of one effect."""
        effect, names = by[0].effect, [one.parameter for one in by]
        x, y, yaw, vx, vy, spin = self._x
        state = SlideState(x, y, yaw, vx, vy, spin, self._t, self._order)
        found = np.zeros((3, len(by), len(self._t)))
        push, rub = effect.push_shapes(names, state), effect.log_friction_shapes(names, state)
        if push is not None:
            found[0], found[1] = push
        if rub is not None:
            found += self._rubbed[:, None] * rub
        if push is not None or rub is not None:
            return found
        neutral = {name: np.asarray(value) for name, value in effect.neutral().items()}
        here = self._slides.values.get(effect.name, neutral)
        for j, one in enumerate(by):
            step = _SHARE * one.step
            changed = {**here, one.parameter: here[one.parameter] + step}
            found[:, j] = self._changed(effect, state, here, changed)
            found[:, j] /= step
        return found

    def _changed(self, effect: Effect, state: SlideState, before: Values, after: Values) -> Array:
        """(3, n steps) by which accelerations change with values of one effect."""
        if effect.turns_friction:
            law = self._slides.law(self._steps, (effect, after))
            return law.acceleration(self._x, self._t, self._order) - self._a
        found = np.zeros_like(self._a)
        ends = [(effect.log_friction(of, state), effect.accelerate(of, state)) for of in (before, after)]
        (rub, push), (rub_after, push_after) = ends
        if rub is not None and rub_after is not None:
            found += self._rubbed * np.expm1(rub_after - rub)
        if push is not None and push_after is not None:
            for axis in range(2):
                found[axis] += push_after[axis] - push[axis]
        return found


def _path(law: SlideLaw, slides: Slides, until: float, step: float) -> tuple[Array, Array]:
    """Times (n, steps) in s and states (n, steps, 6) of the mass, until a time or rest, which is repeated."""
    state = slides.launches.astype(float).T.copy()
    law.to_mass(state)
    time = np.zeros(state.shape[1])
    times, states, near = [time], [state], np.zeros(len(time), bool)
    while True:
        a = law.acceleration(state, time, slides.order)
        left = time_left(state, a, law.inertia)
        near |= law.share() * left <= step
        going = (time < until) & ~(near & (left <= ENDS * step))
        if not going.any():
            return np.stack(times, axis=1), np.stack(states, axis=-1).transpose(1, 2, 0)
        dt = np.where(going, np.where(near, np.minimum(step, law.share() * left), step), 0.0)
        state, time = advanced(law, state, a, dt, time + dt, slides.order), time + dt
        times.append(time)
        states.append(state)


@njit(cache=True, nogil=True)
def _integrated(times, slopes, force):  # type: ignore[no-untyped-def]
    """(steps, 3, p) of place and yaw; slopes (steps, 3, 6), and forces (steps, 3, p)."""
    steps, p = len(times), force.shape[2]
    moved = np.zeros((steps, 3, p))
    x, v, pull = np.zeros((3, p)), np.zeros((3, p)), np.empty((3, p))
    left = np.empty((3, 3))
    for k in range(steps - 1):
        half = (times[k + 1] - times[k]) / 2
        if half > 0:
            # v' = v + half (a(x, v) + a'(x', v')) and x' = x + half (v + v'), solved for v'.
            for i in range(3):
                for j in range(p):
                    pull[i, j] = v[i, j] + half * (force[k, i, j] + force[k + 1, i, j])
                for c in range(3):
                    by_place, by_rate, then = slopes[k, i, c], slopes[k, i, 3 + c], slopes[k + 1, i, c]
                    left[i, c] = (1.0 if i == c else 0.0) - half * (slopes[k + 1, i, 3 + c] + half * then)
                    by_place, by_rate = half * (by_place + then), half * (by_rate + half * then)
                    if by_place != 0.0 or by_rate != 0.0:
                        for j in range(p):
                            pull[i, j] += by_place * x[c, j] + by_rate * v[c, j]
            inverse = np.linalg.inv(left)
            for c in range(3):
                for j in range(p):
                    x[c, j] += half * v[c, j]
            for i in range(3):
                for j in range(p):
                    v[i, j] = (
                        inverse[i, 0] * pull[0, j] + inverse[i, 1] * pull[1, j] + inverse[i, 2] * pull[2, j]
                    )
            for c in range(3):
                for j in range(p):
                    x[c, j] += half * v[c, j]
        for i in range(3):
            for j in range(p):
                moved[k + 1, i, j] = x[i, j]
    return moved


def _between(times: Array, values: Array, moments: Array) -> Array:
    """(frames, ...) values at moments, linear between times; before the first one none."""
    last = int(np.argmax(times))  # a hit at rest repeats its last state
    low = np.clip(np.searchsorted(times[: last + 1], moments, side="right") - 1, 0, max(last - 1, 0))
    span = np.maximum(times[low + 1] - times[low], 1e-300) if last else np.ones(len(moments))
    share = np.clip((moments - times[low]) / span, 0.0, 1.0)[:, None, None]
    return np.asarray((1 - share) * values[low] + share * values[np.minimum(low + 1, last)])
