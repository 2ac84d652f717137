"""Base class of hidden effects on joints, and of the laws by which they act.

A hidden effect has one scalar amplitude, never negative and 0 for no effect, and a shape that is drawn. It
overrides the hooks through which it acts and inherits the others, which change nothing. A shape is
a dictionary of plain numbers, lists and words, which goes into the sealed truth as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from slapshot.arrays import Array
from slapshot.json_types import JsonObject
from slapshot.lab.joints.rig import Rig

Shape = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """Motion of the nominal rig in a session, on which shapes may depend.

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
    """Bounds of an amplitude: a typical one to start a search from, the minimum and the maximum."""

    typical: float
    minimum: float
    maximum: float


@dataclass(frozen=True, eq=False)
class Plant:
    """The plant on which laws act: simulations of all episodes of a session, stepped together.

    Attributes:
        rig: that moves.
        batch: one simulation an episode.
        model: of all of them.
        session: (episodes,) position in the session, from 0 for the first to 1 for the last episode.
    """

    rig: Rig
    batch: Batch
    model: mujoco.MjModel
    session: Array

    @property
    def timestep(self) -> float:
        """S."""
        return self.rig.clock.step

    def dof(self, joint: str) -> int:
        """Column of a joint in forces and velocities."""
        return int(self.model.joint(joint).dofadr[0])


@dataclass(eq=False)
class StepState:
    """State of all episodes in one step.

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
    """A law applied in every step; arrays are changed in place."""

    def command(self, commands: Array, state: StepState) -> None:
        """Change the commands (episodes, joints) of the actuators; `state.load` is the previous load."""

    def drive(self, force: Array, state: StepState) -> None:
        """Change the actuator torques (episodes, joints), N m."""

    def act(self, torque: Array, state: StepState) -> None:
        """Add to the generalised forces (episodes, dofs), N m or N."""

    def push(self, wrench: Array, state: StepState) -> None:
        """Add forces (N) and torques (N m) that act on bodies, (episodes, bodies, 6)."""


class HiddenEffect:
    """A hidden effect.

    Attributes:
        name: as in settings and in the truth.
        catalogued: whether the catalogue of a diagnosis has a counterpart.
        unit: of the amplitude.
        amplitude: meaning of the amplitude.
    """

    name: ClassVar[str]
    catalogued: ClassVar[bool] = True
    unit: ClassVar[str]
    amplitude: ClassVar[str]

    def fits(self, rig: Rig) -> bool:
        """Whether the effect applies to a rig and is observable."""
        return True

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        """Draw the shape; "joint" or "body" is where the effect applies, if anywhere."""
        raise NotImplementedError

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        """Of the amplitude."""
        raise NotImplementedError

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        """Name -> value and unit of the physical parameters."""
        return {}

    def build(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, rig: Rig) -> None:
        """Change the model before it is compiled; joints that are added are not observed by themselves."""

    def tune(self, amplitude: float, shape: Shape, model: mujoco.MjModel, rig: Rig) -> None:
        """Change the compiled model; constants that follow from it are worked out afterwards."""

    def law(self, amplitude: float, shape: Shape, plant: Plant) -> Law | None:
        """The law applied in every step."""
        return None

    def when(self, amplitude: float, shape: Shape, times: Array) -> Array:
        """Times (...) in s at which the joint's encoder is actually read."""
        return times

    def read(self, amplitude: float, shape: Shape, angles: Array) -> Array:
        """Readings of the joint's encoder (episodes, samples) in rad."""
        return angles

    @classmethod
    def has(cls, hook: str) -> bool:
        """Whether the effect overrides a hook."""
        return getattr(cls, hook) is not getattr(HiddenEffect, hook)

    @classmethod
    def moves(cls) -> bool:
        """Whether the effect changes the motion, and not only the readings."""
        return cls.has("build") or cls.has("tune") or cls.has("law")


@dataclass(frozen=True, eq=False)
class Concealed:
    """A hidden effect with its amplitude and shape.

    Attributes:
        effect: the hidden effect.
        amplitude: in the effect's unit.
        shape: drawn shape.
        size: rms change that it alone makes to the joint whose noiseless record changes most, over the
            noise's standard deviation; None where it was not measured.
        requested: size that was requested; None where the amplitude was given.
        bounded: whether the amplitude is the largest or the least one because `requested` cannot be attained.
    """

    effect: HiddenEffect
    amplitude: float
    shape: Shape
    size: float | None = None
    requested: float | None = None
    bounded: bool = False

    def truth(self) -> JsonObject:
        """For the sealed file: plain numbers, lists and words."""
        effect = self.effect
        parameters = effect.parameters(self.amplitude, self.shape)
        return {
            "kind": effect.name,
            "catalogued": effect.catalogued,
            "joint": self.shape.get("joint"),
            "body": self.shape.get("body"),
            "amplitude": self.amplitude,
            "amplitude_unit": effect.unit,
            "amplitude_is": effect.amplitude,
            "size": self.size,
            "size_asked": self.requested,
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
