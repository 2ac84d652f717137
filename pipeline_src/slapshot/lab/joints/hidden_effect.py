"""The face of a kind of physics that a rig for joints can conceal, and of the law that it acts by.

A kind has one scalar amplitude, which is never negative and 0 for nothing at all, and a shape that is drawn.
It overrides the methods of the places where it acts and inherits the others, which change nothing. A shape is
a dictionary of plain numbers, lists and words, which goes into the sealed truth as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from slapshot.arrays import Array
from slapshot.lab.joints.rig import Rig

Shape = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """What a shape may depend on: how a rig moves in a session while it conceals nothing.

    Attributes:
        rig: that moves.
        episodes: of the session.
        seconds: of an episode.
        positions: (episodes, samples, observed) rad of joints, then m of the site.
        speeds: (episodes, samples, joints) rad/s.
        forces: the same, N m of the actuators; of a gripper that is dragged, of the joints' damping.
        peaks: (joints,) N m, largest size of these.
        tip: (episodes, samples, 3) m, of the last link's tip.
    """

    rig: Rig
    episodes: int
    seconds: float
    positions: Array
    speeds: Array
    forces: Array
    peaks: Array
    tip: Array

    def speed(self, joint: int) -> float:
        """Rms in rad/s."""
        return float(np.sqrt((self.speeds[..., joint] ** 2).mean()))

    def force(self, joint: int) -> float:
        """Rms in N m of what the joint's actuator does."""
        return float(np.sqrt((self.forces[..., joint] ** 2).mean()))

    def peak(self, joint: int) -> float:
        """Largest size in N m of what the joint's actuator does."""
        return float(self.peaks[joint])


class Bounds(NamedTuple):
    """Of an amplitude: one to start a search from, the least that can be simulated, the largest possible."""

    usual: float
    least: float
    largest: float


@dataclass(frozen=True, eq=False)
class Plant:
    """What a law acts on: the simulations of all episodes of a session, which take steps together.

    Attributes:
        rig: that moves.
        batch: one simulation an episode.
        model: of all of them.
        place: (episodes,) in the session, from 0 for the first to 1 for the last one.
    """

    rig: Rig
    batch: Batch
    model: mujoco.MjModel
    place: Array

    @property
    def timestep(self) -> float:
        """S."""
        return self.rig.clock.step

    def dof(self, joint: str) -> int:
        """Column of a joint in forces and velocities."""
        return int(self.model.joint(joint).dofadr[0])


@dataclass(eq=False)
class Now:
    """A step of all episodes.

    Attributes:
        time: s from the episodes' start, negative while the rig comes to rest; of the middle of the step, as
            what follows.
        position: (episodes, joints) rad, on the actuators' side of a joint.
        velocity: the same, rad/s.
        speeds: (episodes, dofs), of everything that moves.
        load: (episodes, joints) N m, that the actuators do.
    """

    time: float
    position: Array
    velocity: Array
    speeds: Array
    load: Array


class Law:
    """What a kind does in every step; arrays are changed in place."""

    def command(self, told: Array, now: Now) -> None:
        """What actuators (episodes, joints) are told, as it gets through; `now.load` is that before."""

    def drive(self, force: Array, now: Now) -> None:
        """What actuators (episodes, joints) do, N m."""

    def act(self, torque: Array, now: Now) -> None:
        """Add to what acts on all degrees of freedom (episodes, dofs), N m or N."""

    def push(self, wrench: Array, now: Now) -> None:
        """Add forces (N) and torques (N m) that act on bodies, (episodes, bodies, 6)."""


class HiddenEffect:
    """Physics that can be concealed.

    Attributes:
        name: as in settings and in the truth.
        catalogued: whether a list of what rigs usually conceal has it.
        unit: of the amplitude.
        amplitude: what the amplitude is, in words.
    """

    name: ClassVar[str]
    catalogued: ClassVar[bool] = True
    unit: ClassVar[str]
    amplitude: ClassVar[str]

    def fits(self, rig: Rig) -> bool:
        """Whether it makes sense on a rig, and shows."""
        return True

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        """Draw what the amplitude leaves open; "joint" or "body" says where it applies, if anywhere."""
        raise NotImplementedError

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        """Of the amplitude."""
        raise NotImplementedError

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        """Name -> value and unit of what a person would call this physics by."""
        return {}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        """Change the model before it is compiled; joints that are added are not observed by themselves."""

    def tune(self, amplitude: float, shape: Shape, model: mujoco.MjModel, rig: Rig) -> None:
        """Change the compiled model; constants that follow from it are worked out afterwards."""

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law | None:
        """What it does in every step, from the first one on."""
        return None

    def when(self, amplitude: float, shape: Shape, times: Array) -> Array:
        """Times (...) in s at which the joint's encoder is really read."""
        return times

    def read(self, amplitude: float, shape: Shape, angles: Array) -> Array:
        """The joint's angles (episodes, samples) in rad as its encoder tells them."""
        return angles

    @classmethod
    def has(cls, hook: str) -> bool:
        """Whether the kind overrides a method."""
        return getattr(cls, hook) is not getattr(HiddenEffect, hook)

    @classmethod
    def moves(cls) -> bool:
        """Whether the rig moves differently, and not only its encoders tell something else."""
        return cls.has("build") or cls.has("tune") or cls.has("law")


@dataclass(frozen=True, eq=False)
class Concealed:
    """A kind with its amplitude and its shape: one piece of concealed physics.

    Attributes:
        kind: what.
        amplitude: how much, in the kind's unit.
        shape: what was drawn.
        size: rms change that it alone makes to the joint whose noiseless record changes most, over the
            noise's standard deviation; None where it was not measured.
        asked: size that was asked for; None where the amplitude was given.
        bounded: whether the amplitude is the largest or the least one because `asked` cannot be reached.
    """

    kind: HiddenEffect
    amplitude: float
    shape: Shape
    size: float | None = None
    asked: float | None = None
    bounded: bool = False

    def truth(self) -> dict[str, Any]:
        """For the sealed file: plain numbers, lists and words."""
        kind = self.kind
        parameters = kind.parameters(self.amplitude, self.shape)
        return {
            "kind": kind.name,
            "catalogued": kind.catalogued,
            "joint": self.shape.get("joint"),
            "body": self.shape.get("body"),
            "amplitude": self.amplitude,
            "amplitude_unit": kind.unit,
            "amplitude_is": kind.amplitude,
            "size": self.size,
            "size_asked": self.asked,
            "bounded": self.bounded,
            "parameters": {name: {"value": v, "unit": unit} for name, (v, unit) in parameters.items()},
            "shape": dict(self.shape),
        }


def draw_joint(rig: Rig, rng: np.random.Generator, among: tuple[str, ...] | None = None) -> str:
    """One of a rig's joints."""
    return str(rng.choice(among or rig.joints))


def draw_sign(rng: np.random.Generator) -> float:
    """1 or -1."""
    return float(rng.choice((-1.0, 1.0)))
