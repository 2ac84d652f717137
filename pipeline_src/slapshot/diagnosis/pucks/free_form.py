"""Free forms: what is left, described without a name, as a force or a friction over one variable each.

They compete with the catalogue. Where one of them explains clearly more, the missing physics is not in the
catalogue, and the free form says where it is and how large. Each is a sum of bumps over its variable, so
that it is an effect like any other; it is never registered.
"""

from collections.abc import Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.bases import BOARD
from slapshot.effects.effect import Effect, Parameter, SlideState

SPEEDS = np.linspace(0.2, 3.0, 8)  # m/s
TIMES = np.linspace(0.0, 1.6, 9)  # s
ORDERS = np.linspace(-0.5, 0.5, 7)
HARMONICS = 4  # of the heading
FREE_LAUNCH = "free_launch"

# Parts of a launch along and across its heading, and powers of its speed and heading.
_LAUNCH_PARTS = (
    ("ahead", "m", 0.01),
    ("aside", "m", 0.01),
    ("faster", "m/s", 0.1),
    ("sideways", "m/s", 0.1),
    ("spin", "rad/s", 1.0),
)
_LAUNCH_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (0, 3))

_PHYSICS = "No physics: a smooth function that describes what the catalogue leaves over,\nwhere it acts."
_SOURCE = "Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, section 2.7"


def launch_features(launches: Array) -> Array:
    """(n, 7) powers of speed and heading of launches (n, 5), of order 1."""
    speed = np.hypot(launches[:, 2], launches[:, 3])
    heading = np.arctan2(launches[:, 3], launches[:, 2])
    s = (speed - speed.mean()) / max(float(speed.std()), 1e-3)
    return np.stack([s**i * heading**j for i, j in _LAUNCH_POWERS], axis=1)


def _bumps(centres: Array, x: Array) -> Array:
    """(centres, n) Gaussian bumps whose width is their distance."""
    width = centres[1] - centres[0]
    return np.exp(-((x - centres[:, None]) ** 2) / (2 * width**2))


def _total(values: Mapping[str, Array], prefix: str, shapes: Array) -> Array:
    return sum(values[f"{prefix}_{j}"] * shape for j, shape in enumerate(shapes))


def _parameters(prefix: str, count: int, unit: str, scale: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{prefix}_{j}", unit, -20 * scale, 20 * scale, scale, "weight of one bump")
        for j in range(count)
    )


class FreePlaceForce(Effect):
    name = "free_place"
    phase = "slide"
    follows = "place"
    parameters = (
        *_parameters("ax", len(BOARD), "m/s^2", 0.1),
        *_parameters("ay", len(BOARD), "m/s^2", 0.1),
    )
    physics = _PHYSICS
    source = _SOURCE

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Any force field over the board: it may have curl."""
        weights = [np.array([values[f"{axis}_{j}"] for j in range(len(BOARD))]) for axis in ("ax", "ay")]
        return BOARD.total(weights[0], state.x, state.y), BOARD.total(weights[1], state.x, state.y)

    def reaches(self, parameter: str, places: Array) -> bool:
        """Bumps reach as far as they are wide."""
        return BOARD.near(int(parameter.split("_")[1]), places)


class FreeSpeedForce(Effect):
    name = "free_speed"
    phase = "slide"
    follows = "speed"
    parameters = (
        *_parameters("along", len(SPEEDS), "m/s^2", 0.1),
        *_parameters("across", len(SPEEDS), "m/s^2", 0.1),
    )
    physics = _PHYSICS
    source = _SOURCE

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Along and across the motion, by the speed."""
        speed = state.speed + 1e-9
        shapes = _bumps(SPEEDS, speed)
        along, across = _total(values, "along", shapes) / speed, _total(values, "across", shapes) / speed
        return along * state.vx - across * state.vy, along * state.vy + across * state.vx


class FreeTimeForce(Effect):
    name = "free_time"
    phase = "slide"
    follows = "time"
    parameters = (
        *_parameters("ax", len(TIMES), "m/s^2", 0.1),
        *_parameters("ay", len(TIMES), "m/s^2", 0.1),
    )
    physics = _PHYSICS
    source = _SOURCE

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """In the world's axes, by the time since the release."""
        shapes = _bumps(TIMES, state.time)
        return _total(values, "ax", shapes), _total(values, "ay", shapes)


class FreeHeadingForce(Effect):
    name = "free_heading"
    phase = "slide"
    follows = "heading"
    parameters = (
        *_parameters("along", 2 * HARMONICS, "m/s^2", 0.1),
        *_parameters("across", 2 * HARMONICS, "m/s^2", 0.1),
    )
    physics = _PHYSICS
    source = _SOURCE

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Along and across the motion, by its heading."""
        speed = state.speed + 1e-9
        heading = np.arctan2(state.vy, state.vx)
        shapes = np.array(
            [f(k * heading) for k in range(1, HARMONICS + 1) for f in (np.sin, np.cos)],
        )
        along, across = _total(values, "along", shapes) / speed, _total(values, "across", shapes) / speed
        return along * state.vx - across * state.vy, along * state.vy + across * state.vx


class FreeOrderFriction(Effect):
    name = "free_order"
    phase = "across hits"
    follows = "order"
    parameters = _parameters("log_friction", len(ORDERS), "1", 0.1)
    physics = _PHYSICS
    source = _SOURCE

    def log_friction(self, values: Mapping[str, Array], state: SlideState) -> Array:
        """By the order of hits."""
        return _total(values, "log_friction", _bumps(ORDERS, state.order))


class FreeLaunch(Effect):
    name = FREE_LAUNCH
    phase = "contact"
    follows = "command"
    parameters = tuple(
        Parameter(f"{part}_{j}", unit, -20 * scale, 20 * scale, scale, "weight of one polynomial")
        for part, unit, scale in _LAUNCH_PARTS
        for j in range(len(_LAUNCH_POWERS))
    )
    physics = _PHYSICS
    source = _SOURCE

    def shift_launch(self, values: Mapping[str, float], launches: Array) -> Array:
        """Polynomials of the speed and the heading of the nominal launch."""
        features = launch_features(launches)
        weights = np.array(
            [[values[f"{part}_{j}"] for j in range(len(_LAUNCH_POWERS))] for part, _, _ in _LAUNCH_PARTS]
        )
        return features @ weights.T


FREE_FORMS: tuple[Effect, ...] = (
    FreePlaceForce(),
    FreeSpeedForce(),
    FreeTimeForce(),
    FreeHeadingForce(),
    FreeOrderFriction(),
    FreeLaunch(),
)
