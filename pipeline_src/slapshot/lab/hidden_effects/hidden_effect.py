"""Base class of hidden effects: one scalar amplitude, and a shape that is drawn.

An effect overrides the hooks through which it acts and inherits the others, which change nothing. A
shape is a dictionary of plain numbers, lists and words, which goes into the sealed truth as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.json_types import JsonObject
from slapshot.lab.blade_truth import BladeTruth
from slapshot.lab.surface import Ground
from slapshot.scenes.scene import Scene

Shape = Mapping[str, Any]

Phase = Literal["swing", "contact", "slide", "across hits", "camera"]


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """Hits of the nominal rig, on which shapes may depend.

    Attributes:
        scene: of the rig.
        foot: (2,) m, point of the board at which the camera nominally looks.
        contact_poses: (n, joints) rad, of the arm as it strikes in some of the session's hits.
        rests: (n, 2) m, where they end.
    """

    scene: Scene
    foot: Array
    contact_poses: Array
    rests: Array


class HiddenEffect:
    """A hidden effect; the amplitude is never negative, and 0 is no effect.

    Attributes:
        name: as in settings and in the truth; that of the catalogue's effect where there is one.
        phase: where it acts.
        catalogued: whether the catalogue has a counterpart.
        parameter_match: "same" if `parameters` belong to the same law, "near" for the closest fit; None for
            none.
        unit: of the amplitude.
        amplitude: meaning of the amplitude.
        typical_amplitude: start of a search.
        min_amplitude: smallest that can be simulated in reasonable time.
        max_amplitude: largest that is physically possible.
        observed_in: whether the effect moves rest points, or only the track at equal times.
        changes_launch: whether the launch changes by more than an effect on the slide changes it.
    """

    name: ClassVar[str]
    phase: ClassVar[Phase]
    catalogued: ClassVar[bool] = True
    parameter_match: ClassVar[Literal["same", "near"] | None] = "near"
    unit: ClassVar[str]
    amplitude: ClassVar[str]
    typical_amplitude: ClassVar[float]
    min_amplitude: ClassVar[float] = 0.0
    max_amplitude: ClassVar[float]
    observed_in: ClassVar[Literal["rest", "track"]] = "rest"
    changes_launch: ClassVar[bool] = False

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        """Draw the shape."""
        return {}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        """Parameter of the catalogue's effect -> closest value, in its unit."""
        return {}

    @classmethod
    def has(cls, hook: str) -> bool:
        """Whether the effect overrides a hook."""
        return getattr(cls, hook) is not getattr(HiddenEffect, hook)

    # --- Swing and contact

    def delay(self, amplitude: float, shape: Shape, chance: float) -> float:
        """Command delay in s; `chance` is a standard normal draw of each hit."""
        return 0.0

    def follow(self, amplitude: float, shape: Shape, values: Array, period: float) -> Array:
        """Commands (ticks, joints), one every `period` s, as they reach the arm."""
        return values

    def settling(self, amplitude: float, shape: Shape) -> float:
        """Time in s for which `follow` continues after the last command."""
        return 0.0

    def blade(self, amplitude: float, shape: Shape) -> BladeTruth | None:
        """A compliant striker; None for the scene's own."""
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
        """Log factor on a hit's friction; `place` is its position in the session, 0 (first) to 1 (last)."""
        return 0.0

    def yaw(self, amplitude: float, shape: Shape, chance: float) -> float:
        """Rad by which the object is turned before the hit; `chance` as in `delay`."""
        return 0.0

    # --- Camera

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        """Positions (n, 2) in m as reported by the camera."""
        return places

    def camera_delay(self, amplitude: float, shape: Shape, place: float) -> float:
        """Age of the camera's data in s; `place` as in `log_friction`."""
        return 0.0


@dataclass(frozen=True, eq=False)
class Concealed:
    """A hidden effect with its amplitude and shape.

    Attributes:
        effect: the hidden effect.
        amplitude: in the effect's unit.
        shape: drawn shape.
        displacement: rms shift of the rest points, or of the seen track, over the rms distance of repeats'
            rest points from their mean; None where it was not measured.
        requested: displacement that was requested; None where the amplitude was given.
        bounded: whether the amplitude is the largest or the least one because `requested` cannot be attained.
    """

    effect: HiddenEffect
    amplitude: float
    shape: Shape
    displacement: float | None = None
    requested: float | None = None
    bounded: bool = False

    def truth(self) -> JsonObject:
        """For the sealed file: plain numbers, lists and words."""
        effect = self.effect
        return {
            "kind": effect.name,
            "catalogued": effect.catalogued,
            "phase": effect.phase,
            "amplitude": self.amplitude,
            "amplitude_unit": effect.unit,
            "amplitude_is": effect.amplitude,
            "displacement": self.displacement,
            "displacement_asked": self.requested,
            "displacement_of": effect.observed_in,
            "bounded": self.bounded,
            "parameters_are": effect.parameter_match,
            "parameters": effect.parameters(self.amplitude, self.shape),
            "shape": dict(self.shape),
        }
