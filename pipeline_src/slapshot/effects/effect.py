"""The face of an effect: physics that a nominal scene lacks.

An effect has parameters with a neutral value at which it is absent, and changes the simulation at one of
five places, its phase. It overrides the methods of the places it changes and inherits the others, which
change nothing. All arrays of the slide hold one entry a hit, so that thousands are simulated at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.scenes.scene import SceneInfo

Phase = Literal["swing", "contact", "slide", "across hits", "camera"]
# What the mark of an effect follows: the residual changes with it.
Follows = Literal["place", "speed", "heading", "spin", "time", "order", "command"]
ARM_JOINTS = 7  # of the largest arm: an effect with a parameter for each joint has so many


@dataclass(frozen=True)
class Parameter:
    """A number of an effect.

    Attributes:
        name: within the effect.
        unit: "1" for none.
        low, high: what is physically possible.
        scale: of a plain case; the prior's standard deviation about the neutral value.
        meaning: what a positive value is, in a few words.
        neutral: where the effect is absent.
    """

    name: str
    unit: str
    low: float
    high: float
    scale: float
    meaning: str
    neutral: float = 0.0


@dataclass(frozen=True)
class SlideState:
    """n flat discs that slide, at one moment.

    Attributes:
        x, y: (n,) m, of the centre of mass, in the world.
        yaw: (n,) rad, from the orientation before the hit.
        vx, vy: (n,) m/s.
        spin: (n,) rad/s.
        time: (n,) s since the launch.
        order: (n,) place in the recording, from -1/2 (first hit) to 1/2 (last hit).
    """

    x: Array
    y: Array
    yaw: Array
    vx: Array
    vy: Array
    spin: Array
    time: Array
    order: Array

    @property
    def speed(self) -> Array:
        """(n,) m/s."""
        return np.hypot(self.vx, self.vy)


class Effect:
    """Physics that a nominal scene lacks; `values` maps parameter -> number or (n,) array.

    Attributes:
        name: as in verdicts and of the file.
        phase: where it acts.
        follows: the variable that its mark follows.
        parameters: with their neutral values.
        physics: what it is, in two lines.
        source: where that stands.
        known_to: share of what it does by which its law may err.
        errs_by_joint: whether joints of one arm differ in what has one value for all of them here.
    """

    name: ClassVar[str]
    phase: ClassVar[Phase]
    follows: ClassVar[Follows]
    parameters: ClassVar[tuple[Parameter, ...]]
    physics: ClassVar[str]
    source: ClassVar[str]
    known_to: ClassVar[float] = 0.15
    errs_by_joint: ClassVar[bool] = False

    # --- Swing and contact

    def command(self, values: Mapping[str, float], targets: Array, period: float) -> Array:
        """Servo targets (ticks, joints) in rad, one every `period` s, as the servo really gets them."""
        return targets

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Change the scene's model; names of joints, actuators and sites stay."""

    # --- Slide

    def accelerate(self, values: Mapping[str, Array], state: SlideState) -> tuple[Array, Array] | None:
        """(n,), (n,) m/s^2 along world x and y, beside dry friction; None for none."""
        return None

    def log_friction(self, values: Mapping[str, Array], state: SlideState) -> Array | None:
        """(n,) logarithm of the factor on dry friction; None for 0."""
        return None

    def cross_anisotropy(self, values: Mapping[str, Array]) -> Array | None:
        """(n,) off-diagonal of the symmetric logarithm of the friction tensor; None for 0."""
        return None

    def centre_offset(self, values: Mapping[str, Array]) -> tuple[Array, Array] | None:
        """(n,), (n,) m from the shape's centre to the centre of mass, at yaw 0; None for 0."""
        return None

    def log_inertia(self, values: Mapping[str, Array]) -> Array | None:
        """(n,) logarithm of the factor on the moment of inertia about the centre of mass; None for 0."""
        return None

    def push_shapes(self, parameters: Sequence[str], state: SlideState) -> tuple[Array, Array] | None:
        """(p, n), (p, n) m/s^2 by a unit of each parameter, of a push that is linear in all of them.

        None, which leaves derivatives to differences.
        """
        return None

    def log_friction_shapes(self, parameters: Sequence[str], state: SlideState) -> Array | None:
        """(p, n) the same of the logarithm of the factor on friction."""
        return None

    # --- Camera

    def see(self, values: Mapping[str, Array], places: Array, camera: Array) -> Array:
        """Places (n, frames, 2) in m as the camera reports them.

        Args:
            values: of the parameters, (n,) each.
            places: where the object is.
            camera: (2,) m, point of the plane that the camera looks at.
        """
        return places

    def camera_delay(self, values: Mapping[str, Array]) -> Array | None:
        """(n,) s by which the camera's clock is late: it reports at t what was so at t - delay."""
        return None

    # --- For all

    def reaches(self, parameter: str, places: Array) -> bool:
        """Whether a parameter can matter to an object that was at `places` (n, 2) in m."""
        return True

    def _has(self, *hooks: str) -> bool:
        return any(getattr(type(self), hook) is not getattr(Effect, hook) for hook in hooks)

    def neutral(self) -> dict[str, float]:
        """Values at which the effect is absent."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}

    @property
    def acts_on_launch(self) -> bool:
        """Whether it shows before the object slides, in the motion of arm and striker or their contact."""
        return self.phase in ("swing", "contact") or type(self).edit is not Effect.edit

    @property
    def acts_on_slide(self) -> bool:
        """Whether it changes how the object slides."""
        return self._has("accelerate", "log_friction", "cross_anisotropy", "centre_offset", "log_inertia")

    @property
    def moves_mass(self) -> bool:
        """Whether it changes where an object's mass lies."""
        return self._has("centre_offset", "log_inertia")

    @property
    def turns_friction(self) -> bool:
        """Whether it changes the directions in which friction is large."""
        return self._has("cross_anisotropy")

    @property
    def acts_on_camera(self) -> bool:
        """Whether it changes what the camera reports."""
        return type(self).see is not Effect.see or self.delays

    @property
    def delays(self) -> bool:
        """Whether it changes when the camera saw what it reports."""
        return type(self).camera_delay is not Effect.camera_delay
