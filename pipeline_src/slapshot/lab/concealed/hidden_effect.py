"""The face of a concealed kind: one scalar amplitude, and a shape that is drawn.

A kind overrides the methods of the places where it acts and inherits the others, which change nothing. A
shape is a dictionary of plain numbers, lists and words, which goes into the sealed truth as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.lab.blade_truth import BladeTruth
from slapshot.lab.surface import Ground
from slapshot.scenes.scene import Scene

Shape = Mapping[str, Any]

Phase = Literal["swing", "contact", "slide", "across hits", "camera"]


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """What a shape may depend on: where things happen on a rig that conceals nothing.

    Attributes:
        scene: of the rig.
        foot: (2,) m, point of the board that the camera is meant to look at.
        contact_poses: (n, joints) rad, of the arm as it strikes in some of the session's hits.
        rests: (n, 2) m, where they end.
    """

    scene: Scene
    foot: Array
    contact_poses: Array
    rests: Array


class HiddenEffect:
    """Physics that can be concealed; `amplitude` is never negative, and 0 is nothing at all.

    Attributes:
        name: as in settings and in the truth; that of the catalogue's effect where there is one.
        phase: where it acts.
        catalogued: whether the catalogue has an effect that means the same.
        like: whether `parameters` are numbers of the same law, or those that come nearest; None without any.
        unit: of the amplitude.
        amplitude: what the amplitude is, in words.
        usual: an amplitude to start a search from.
        least: amplitude that can be simulated in decent time.
        largest: amplitude that is physically possible.
        shows: whether rest points move, or what the camera sees on the way at equal times.
        strikes: whether the launch changes by more than what acts on the slide does there.
    """

    name: ClassVar[str]
    phase: ClassVar[Phase]
    catalogued: ClassVar[bool] = True
    like: ClassVar[Literal["same", "near"] | None] = "near"
    unit: ClassVar[str]
    amplitude: ClassVar[str]
    usual: ClassVar[float]
    least: ClassVar[float] = 0.0
    largest: ClassVar[float]
    shows: ClassVar[Literal["rest", "track"]] = "rest"
    strikes: ClassVar[bool] = False

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        """Draw what the amplitude leaves open."""
        return {}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        """Parameter of the catalogue's effect -> the value of it that comes nearest, in its unit."""
        return {}

    @classmethod
    def has(cls, hook: str) -> bool:
        """Whether the kind overrides a method."""
        return getattr(cls, hook) is not getattr(HiddenEffect, hook)

    # --- Swing and contact

    def delay(self, amplitude: float, shape: Shape, chance: float) -> float:
        """S by which commands come late; `chance` is standard normal, drawn for each hit."""
        return 0.0

    def follow(self, amplitude: float, shape: Shape, values: Array, period: float) -> Array:
        """Commands (ticks, joints), one every `period` s, as they get through."""
        return values

    def settling(self, amplitude: float, shape: Shape) -> float:
        """S that `follow` goes on after commands have stopped."""
        return 0.0

    def blade(self, amplitude: float, shape: Shape) -> BladeTruth | None:
        """A striker that bends; None for the scene's own."""
        return None

    def edit(self, amplitude: float, shape: Shape, spec: mujoco.MjSpec, scene: Scene) -> None:
        """Change the scene's model; the names in `scene.info` keep their meaning."""

    def bounce(self, amplitude: float, shape: Shape, solref: Array, speed: float) -> Array:
        """Time constant (s) and damping ratio (2,) of the contact when the striker comes at `speed` m/s."""
        return solref

    # --- Slide

    def ground(self, amplitude: float, shape: Shape, ground: Ground) -> Ground:
        """The ground with what acts on a sliding object."""
        return ground

    def log_friction(self, amplitude: float, shape: Shape, place: float) -> float:
        """Logarithm of the factor on friction of a hit; `place` is 0 for the first and 1 for the last."""
        return 0.0

    def yaw(self, amplitude: float, shape: Shape, chance: float) -> float:
        """Rad by which the object is turned before the hit; `chance` as in `delay`."""
        return 0.0

    # --- Camera

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        """Places (n, 2) in m as the camera reports them."""
        return places

    def camera_delay(self, amplitude: float, shape: Shape, place: float) -> float:
        """S by which what the camera reports is old; `place` as in `log_friction`."""
        return 0.0


@dataclass(frozen=True, eq=False)
class Concealed:
    """A kind with its amplitude and its shape: one piece of concealed physics.

    Attributes:
        kind: what.
        amplitude: how much, in the kind's unit.
        shape: what was drawn.
        displacement: rms shift of the rest points, or of the seen track, over the rms distance of repeats'
            rest points from their mean; None where it was not measured.
        asked: displacement that was asked for; None where the amplitude was given.
        bounded: whether the amplitude is the largest or the least one because `asked` cannot be reached.
    """

    kind: HiddenEffect
    amplitude: float
    shape: Shape
    displacement: float | None = None
    asked: float | None = None
    bounded: bool = False

    def truth(self) -> dict[str, Any]:
        """For the sealed file: plain numbers, lists and words."""
        kind = self.kind
        return {
            "kind": kind.name,
            "catalogued": kind.catalogued,
            "phase": kind.phase,
            "amplitude": self.amplitude,
            "amplitude_unit": kind.unit,
            "amplitude_is": kind.amplitude,
            "displacement": self.displacement,
            "displacement_asked": self.asked,
            "displacement_of": kind.shows,
            "bounded": self.bounded,
            "parameters_are": kind.like,
            "parameters": kind.parameters(self.amplitude, self.shape),
            "shape": dict(self.shape),
        }
