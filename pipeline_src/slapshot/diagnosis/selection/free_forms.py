"""Free forms: nonparametric forces and reading errors over one variable.

They are hypotheses like any other. Where one explains what no named effect does, an effect outside the
catalogue is missing, and the form shows where it is and on which variable it depends.
"""

from collections.abc import Callable, Iterator
from typing import ClassVar

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.effect import (
    Joint,
    JointEffect,
    Observed,
    Parameter,
    RigMotion,
    State,
    on_joint,
)
from slapshot.effects.joints.parts import weight

BUMPS = 6
FREE = "free_"  # names of free forms begin so
_WIDTH = 1.2  # of a bump, in distances between bumps
_SLOWEST = 1e-3  # of the largest speed, below which a motion has no direction
_FEWEST_EPISODES = 4  # for what differs between episodes
_MOST_EPISODES = 40  # which have forces of their own: these tell whether any has


def is_free(effect: JointEffect) -> bool:
    """Whether an effect is a free form."""
    return effect.name.startswith(FREE)


class FreeForce(JointEffect):
    """A force on one joint, as a sum of bumps over one variable."""

    name = FREE + "force"
    physics = "A force of unknown shape."
    source = "Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), section 2.7"
    phrase = "a force at {part} of unknown shape"
    follows: ClassVar[dict[str, Callable[[Joint, State], Array]]] = {
        "position": lambda joint, state: state.q[:, joint.q],
        "velocity": lambda joint, state: state.v[:, joint.v],
        "load": lambda joint, state: state.torque[:, joint.v],
        "time": lambda joint, state: state.time,
        "session": lambda joint, state: state.order,
    }

    def __init__(self, joint: Joint, variable: str, low: float, high: float) -> None:
        scale = 0.3 * joint.torque
        weights = [Parameter(f"weight_{i}", joint.unit, scale, probe=0.01 * scale) for i in range(BUMPS)]
        super().__init__(joint.name, weights, f"over {variable}")
        self._joint, self.variable, self.low, self.high = joint, variable, low, high

    def basis(self, at: Array) -> Array:
        """Bumps at values of the variable, (n, BUMPS)."""
        return _bumps(at, self.low, self.high)

    def force(self, state: State, values: Array) -> Array:
        """The sum of all bumps."""
        at = self.follows[self.variable](self._joint, state)
        return on_joint(self._joint, self.basis(at) @ values, state.v.shape[1])


class FreeReading(JointEffect):
    """An error of the readings of one joint, as a sum of bumps over its position, its speed or the session.

    Over speed, what is straight is a delay; a sensor that sticks or lags by its own law is not.
    """

    name = FREE + "reading"
    physics = "Readings are off by an unknown function."
    source = "Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), section 2.7"
    phrase = "an error of the readings of {part} of unknown shape"
    follows: ClassVar[dict[str, Callable[[Observed, int], Array]]] = {
        "position": lambda seen, column: seen.y[:, column],
        "velocity": lambda seen, column: seen.rate[:, column],
        "session": lambda seen, column: seen.order,
    }

    def __init__(self, joint: Joint, columns: list[int], variable: str, low: float, high: float) -> None:
        weights = [Parameter(f"weight_{i}", joint.angle_unit, 0.01, probe=1e-4) for i in range(BUMPS)]
        super().__init__(joint.name, weights, f"over {variable}")
        self._columns, self.variable, self.low, self.high = columns, variable, low, high

    def observe(self, seen: Observed, values: Array) -> Array:
        """The sum of all bumps."""
        added = np.zeros_like(seen.y)
        for column in self._columns:
            at = self.follows[self.variable](seen, column)
            added[:, column] = _bumps(at, self.low, self.high) @ values
        return added


class FreeForceAlong(JointEffect):
    """A force on a free body along its motion, as a sum of bumps over its speed."""

    name = FREE + "force_along"
    physics = "A force along the motion, of unknown shape."
    source = FreeForce.source
    phrase = "a force along the motion of {part} of unknown shape"
    variable = "velocity"

    def __init__(self, body: str, v: int, weight: float, speed: float) -> None:
        weights = [Parameter(f"weight_{i}", "N", 0.3 * weight, probe=3e-3 * weight) for i in range(BUMPS)]
        super().__init__(body, weights, "over its speed")
        self._v, self._fastest = v, 2.2 * speed

    def force(self, state: State, values: Array) -> Array:
        """The sum of all bumps, against the motion."""
        force, velocity = np.zeros_like(state.v), state.v[:, self._v : self._v + 3]
        speed = np.linalg.norm(velocity, axis=1)
        size = _bumps(speed, 0.0, self._fastest) @ values
        force[:, self._v : self._v + 3] = (
            -velocity * (size / np.maximum(speed, _SLOWEST * self._fastest))[:, None]
        )
        return force


class FreeForceAcross(JointEffect):
    """A force on a free body across its motion, as spin makes, another one in each episode."""

    name = FREE + "force_across"
    physics = "A force across the motion that differs from one episode to the next, as by spin."
    source = "Mehta (1985), Annual Review of Fluid Mechanics 17"
    phrase = "a force across the motion of {part}, another one in each episode"
    variable = "episode"

    def __init__(self, body: str, v: int, weight: float, speed: float, orders: Array) -> None:
        names = [f"{axis}_{episode}" for episode in range(len(orders)) for axis in "xyz"]
        super().__init__(body, [Parameter(name, "N", 0.3 * weight, probe=3e-3 * weight) for name in names])
        self._v, self._speed, self._orders = v, max(speed, 1e-9), orders

    def force(self, state: State, values: Array) -> Array:
        """An axis of each episode times the velocity; 0 in others."""
        force, velocity = np.zeros_like(state.v), state.v[:, self._v : self._v + 3]
        episode = np.clip(np.searchsorted(self._orders, state.order), 0, len(self._orders) - 1)
        known = np.isclose(self._orders[episode], state.order)
        axes = values.reshape(-1, 3)[episode] * known[:, None]
        force[:, self._v : self._v + 3] = np.cross(axes, velocity) / self._speed
        return force


def free_forms(rig: RigMotion, segments: Segments) -> Iterator[JointEffect]:
    """All free forms of a rig's joints and free bodies."""
    yield from _of_free_bodies(rig, np.unique(segments.order)[:_MOST_EPISODES])
    longest = float(segments.time[segments.inside].max(initial=0.0))
    several = rig.episodes >= _FEWEST_EPISODES
    for joint in rig.joints:
        span = 2.2 * joint.travel
        yield FreeForce(joint, "position", joint.middle - span, joint.middle + span)
        yield FreeForce(joint, "velocity", -2.2 * joint.speed, 2.2 * joint.speed)
        gears = np.abs(rig.model.actuator_gear[list(joint.actuators), 0])
        largest = float(gears @ np.array(joint.largest)) if joint.actuators else 0.0
        if largest > 0:
            yield FreeForce(joint, "load", -largest, largest)
        if several:
            yield FreeForce(joint, "time", 0.0, longest)
            yield FreeForce(joint, "session", -0.5, 0.5)
        columns = [s.column for s in rig.sensed if s.joint == joint.name and s.quantity == "position"]
        if columns:
            yield FreeReading(joint, columns, "position", joint.middle - span, joint.middle + span)
            yield FreeReading(joint, columns, "velocity", -2.2 * joint.speed, 2.2 * joint.speed)
            if several:
                yield FreeReading(joint, columns, "session", -0.5, 0.5)


def _of_free_bodies(rig: RigMotion, orders: Array) -> Iterator[JointEffect]:
    for body, v in rig.flying:
        name, own = rig.model.body(body).name, weight(rig.model, body)
        yield FreeForceAlong(name, v, own, rig.speed)
        if rig.episodes >= _FEWEST_EPISODES:
            yield FreeForceAcross(name, v, own, rig.speed, orders)


def _bumps(at: Array, low: float, high: float) -> Array:
    centres = np.linspace(low, high, BUMPS)
    width = _WIDTH * (centres[1] - centres[0])
    # Constant extrapolation.
    inside = np.clip(at, low, high)
    return np.exp(-0.5 * ((inside[:, None] - centres) / width) ** 2)
