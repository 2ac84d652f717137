"""Free forms: what is left, described without a name, as a force or a friction over one variable each.

They compete with the catalogue. Where one of them explains clearly more, the missing physics is not in the
catalogue, and the free form says where it is and how large. Each is a sum of bumps over its variable, so
that it is an effect like any other; it is never registered.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.bases import COARSE_BOARD
from slapshot.effects.effect import ARM_JOINTS, Effect, Parameter, SlideState

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
_CONTACT_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0))  # of offset and angle

_PHYSICS = "No physics: a smooth function that describes what the catalogue leaves over,\nwhere it acts."
_SOURCE = "Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, section 2.7"


def launch_features(launches: Array) -> Array:
    """(n, 7) powers of speed and heading of launches (n, 5), of order 1."""
    speed = np.hypot(launches[:, 2], launches[:, 3])
    heading = np.arctan2(launches[:, 3], launches[:, 2])
    s = (speed - speed.mean()) / max(float(speed.std()), 1e-3)
    return np.stack([s**i * heading**j for i, j in _LAUNCH_POWERS], axis=1)


def contact_features(approach: Array) -> Array:
    """(n, 7) powers of where and at which angle faces meet objects (n, 2), of order 1."""
    offset, angle = ((x - x.mean()) / max(float(x.std()), 1e-3) for x in approach.T)
    return np.stack([offset**i * angle**j for i, j in _CONTACT_POWERS], axis=1)


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


def _along_motion(along: Array, across: Array, state: SlideState) -> tuple[Array, Array]:
    """Accelerations (n,), (n,) in the world's axes of those along the motion and to its left."""
    speed = state.speed + 1e-9
    along, across = along / speed, across / speed
    return along * state.vx - across * state.vy, along * state.vy + across * state.vx


class FreePlaceForce(Effect):
    name = "free_place"
    phase = "slide"
    follows = "place"
    parameters = (
        *_parameters("ax", len(COARSE_BOARD), "m/s^2", 0.1),
        *_parameters("ay", len(COARSE_BOARD), "m/s^2", 0.1),
    )
    physics = _PHYSICS
    source = _SOURCE

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array]:
        """Any force field over the board: it may have curl."""
        weights = [
            np.array([values[f"{axis}_{j}"] for j in range(len(COARSE_BOARD))]) for axis in ("ax", "ay")
        ]
        return COARSE_BOARD.total(weights[0], state.x, state.y), COARSE_BOARD.total(
            weights[1], state.x, state.y
        )

    def push_shapes(self, parameters: Sequence[str], state: SlideState) -> tuple[Array, Array]:
        """Of some bumps along x, and of some along y."""
        axes = np.array([name[:2] for name in parameters])
        shapes = COARSE_BOARD.shapes([int(name.split("_")[1]) for name in parameters], state.x, state.y)
        along_x, along_y = ((axes == axis)[:, None] * shapes for axis in ("ax", "ay"))
        return along_x, along_y

    def reaches(self, parameter: str, places: Array) -> bool:
        """Bumps reach as far as they are wide."""
        return COARSE_BOARD.near(int(parameter.split("_")[1]), places)


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
        shapes = _bumps(SPEEDS, state.speed)
        return _along_motion(_total(values, "along", shapes), _total(values, "across", shapes), state)


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
        heading = np.arctan2(state.vy, state.vx)
        shapes = np.array(
            [f(k * heading) for k in range(1, HARMONICS + 1) for f in (np.sin, np.cos)],
        )
        return _along_motion(_total(values, "along", shapes), _total(values, "across", shapes), state)


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


@dataclass(frozen=True)
class NominalLaunches:
    """What the nominal scene says of n launches, on which free forms of launches stand.

    Attributes:
        simulated: (n, 5) x, y (m), vx, vy (m/s), spin (rad/s).
        by_joints: (n, 5, 2 j) by offset (rad) and rate (rad/s) of each joint about the contact.
        approach: (n, 2) m from the middle of the striker's face to the object along the face, and rad from
            the face's normal to the striker's velocity there, at the contact.
    """

    simulated: Array
    by_joints: Array
    approach: Array

    @cached_property
    def turn(self) -> Array:
        """(n, 5, 5) from along and across the heading to x and y."""
        heading = np.arctan2(self.simulated[:, 3], self.simulated[:, 2])
        cosine, sine = np.cos(heading), np.sin(heading)
        found = np.tile(np.eye(5), (len(heading), 1, 1))
        for k in (0, 2):
            found[:, k, k] = found[:, k + 1, k + 1] = cosine
            found[:, k, k + 1], found[:, k + 1, k] = -sine, sine
        return found


class FreeLaunchForm(Effect):
    """A free form of launches: linear in its parameters."""

    follows = "command"
    physics = _PHYSICS
    source = _SOURCE

    @abstractmethod
    def basis(self, of: NominalLaunches) -> Array:
        """(n, 5, p) change of launches by each parameter, along x and y."""


def _polynomials(count: int) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{part}_{j}", unit, -20 * scale, 20 * scale, scale, "weight of one polynomial")
        for part, unit, scale in _LAUNCH_PARTS
        for j in range(count)
    )


class FreeLaunch(FreeLaunchForm):
    name = FREE_LAUNCH
    phase = "contact"
    parameters = _polynomials(len(_LAUNCH_POWERS))

    def basis(self, of: NominalLaunches) -> Array:
        """Polynomials of the speed and the heading of the nominal launch."""
        features = launch_features(of.simulated)
        return of.turn @ np.concatenate([np.einsum("nf,k->nkf", features, e) for e in np.eye(5)], axis=2)


class FreeContact(FreeLaunchForm):
    name = "free_contact"
    phase = "contact"
    parameters = _polynomials(len(_CONTACT_POWERS))

    def basis(self, of: NominalLaunches) -> Array:
        """Polynomials of where and at which angle the striker's face meets the object, by the speed."""
        features = contact_features(of.approach)
        speed = np.hypot(of.simulated[:, 2], of.simulated[:, 3])
        by_speed = (speed / max(float(speed.mean()), 1e-3))[:, None]
        parts = [features, features, features * by_speed, features * by_speed, features * by_speed]
        by_part = [np.einsum("nf,k->nkf", f, e) for f, e in zip(parts, np.eye(5), strict=True)]
        return of.turn @ np.concatenate(by_part, axis=2)


class FreeArm(FreeLaunchForm):
    """Every joint moved by an offset, and by a rate, about the contact; of an arm of seven joints."""

    name = "free_arm"
    phase = "swing"
    parameters = (
        *(
            Parameter(f"offset_{j}", "rad", -0.2, 0.2, 0.01, "of one joint, the same in all hits")
            for j in range(ARM_JOINTS)
        ),
        *(
            Parameter(f"rate_{j}", "rad/s", -1.0, 1.0, 0.05, "of one joint, the same in all hits")
            for j in range(ARM_JOINTS)
        ),
    )

    def basis(self, of: NominalLaunches) -> Array:
        """As simulated; what an arm of fewer joints lacks does nothing."""
        joints = of.by_joints.shape[2] // 2
        found = np.zeros((*of.by_joints.shape[:2], 2 * ARM_JOINTS))
        for first, part in ((0, of.by_joints[..., :joints]), (ARM_JOINTS, of.by_joints[..., joints:])):
            found[..., first : first + min(joints, ARM_JOINTS)] = part[..., :ARM_JOINTS]
        return found


FREE_FORMS: tuple[Effect, ...] = (
    FreePlaceForce(),
    FreeSpeedForce(),
    FreeTimeForce(),
    FreeHeadingForce(),
    FreeOrderFriction(),
    FreeLaunch(),
    FreeContact(),
    FreeArm(),
)
