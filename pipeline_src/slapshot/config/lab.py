"""Block `lab` of a recording: the stand-in rigs that are drawn, and how they are recorded."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from slapshot.config.scene import Scene
from slapshot.config.trajectories import ScriptedHits
from slapshot.config.values import (
    Box,
    Coefficient,
    Count,
    Distance,
    Duration,
    Few,
    Interval,
    Length,
    Mass,
    MayMiss,
    Name,
    PositiveCoefficient,
    PositiveRatio,
    Range,
    Rate,
    Ratio,
    Scatter,
    Share,
    Stiffness,
)
from slapshot.validation import Model, ProblemAtError

_LEAST_FRAMES = 4  # of an object at rest: of fewer, none are sure to show where it rests

# In the order of slapshot.lab.concealed.registry, which a configuration is checked without.
ConcealedKind = Literal[
    "command_delay", "tracking_lag", "servo_gain", "joint_elasticity", "backlash", "crooked_arm",
    "compliant_blade", "restitution", "blade_friction", "blade_yaw", "curved_blade",
    "tilt", "uneven_board", "place_friction", "linear_drag", "quadratic_drag", "stribeck_friction",
    "turned_anisotropy", "curl", "offcentre_mass", "attracting_spot", "tether", "pulsing_fan",
    "friction_drift", "camera_scale", "camera_rotation", "camera_time", "lens_distortion",
]  # fmt: skip
Keep = Literal["full", "no encoders", "tracks only", "rest points only"]


class Repeats(Model):
    """Commands that are executed several times, which shows what differs from hit to hit."""

    commands: Annotated[int, Field(ge=0, le=10_000)] = Field(description="that are executed several times")
    times: Annotated[int, Field(ge=0, le=10_000)] = Field(
        description="that each of them is, with each object"
    )

    @property
    def hits(self) -> int:
        """How many hits of an object they take."""
        return self.commands * self.times


class RigObject(Model):
    """What is hit."""

    mass_kg: Range[Mass] = Field(description="kg")
    friction_x: Range[PositiveCoefficient] = Field(description="of object and board, along x")
    friction_ratio: Range[PositiveRatio] = Field(description="friction along y over that along x")
    friction_torsional_m: Range[Coefficient] = Field(description="m, of object and board")


class Blade(Model):
    """A blade that bends."""

    segments: Annotated[int, Field(ge=2, le=100)] = Field(description="that hinges join")
    stiffness_nm_rad: Range[Stiffness] = Field(description="N m/rad, of its hinges")
    twist_stiffness_nm_rad: Range[Stiffness] | None = Field(
        description="N m/rad; null for a blade that does not twist"
    )
    damping_ratio: Range[Ratio] = Field(description="of its hinges")


class Board(Model):
    """A board that is uneven."""

    rms_slope: Range[Share] = Field(description="m/m")
    wavelength_m: Interval[Length] = Field(description="shortest and longest")
    waves: Few = Field(description="how many, in all directions")


class FrictionField(Model):
    """Friction that differs from place to place."""

    rms: Range[Coefficient] = Field(description="of the logarithm of friction")
    wavelength_m: Interval[Length] = Field(description="shortest and longest")
    waves: Few = Field(description="how many, in all directions")


class HitScatter(Model):
    """What differs from hit to hit, as standard deviations."""

    start_error_sd_m: Scatter = Field(description="along x and along y")
    speed_sd: Scatter = Field(description="of the logarithm of the pace")
    joint_offset_sd_rad: Annotated[list[Scatter], Field(max_length=100)] = Field(description="of each joint")
    friction_sd: Scatter = Field(description="of the logarithm of friction")

    @property
    def nothing(self) -> bool:
        """Whether all hits of one command are alike."""
        return not any((self.start_error_sd_m, self.speed_sd, self.friction_sd, *self.joint_offset_sd_rad))


class Camera(Model):
    """The ceiling camera."""

    rate_hz: Rate = Field(description="frames a second")
    noise_sd_m: Scatter = Field(description="along x and along y")
    noise_time_s: Annotated[float, Field(ge=0, le=60)] = Field(
        description="over which noise is alike; 0 for white noise"
    )
    missing_share: Annotated[float, Field(ge=0, lt=1)] = Field(description="of frames that are lost")
    mistrack_share: Share = Field(description="of frames that show something else")
    mistrack_m: Interval[Distance] = Field(description="nearest and farthest that they are off")
    after_rest_s: Duration = Field(description="that the camera goes on after rest")
    view_m: Box | None = Field(description="lowest x, highest x, lowest y, highest y; null for all")

    @model_validator(mode="after")
    def _sees_rests(self) -> "Camera":
        frames = int(self.rate_hz * self.after_rest_s)
        if frames < _LEAST_FRAMES:
            raise ProblemAtError(
                ("after_rest_s",),
                f"{self.after_rest_s} s at {self.rate_hz} Hz show an object at rest in {frames} frames; "
                f"raise one of them until there are {_LEAST_FRAMES}",
            )
        return self


class Joints(Model):
    """The recording of the arm."""

    rate_hz: Rate = Field(description="of commands and readings in the recording")
    noise_sd_rad: Scatter = Field(description="of the encoders")


class ConcealedEffect(Model):
    """Physics that the rig conceals, by its size or by what it does."""

    kind: ConcealedKind = Field(description="see slapshot.lab.concealed")
    amplitude: MayMiss[Range[Ratio]] = Field(default=None, description="in the unit of the kind")
    displacement: MayMiss[Range[PositiveRatio]] = Field(
        default=None, description="rms shift of rest points, or of tracks, over the hit-to-hit scatter"
    )

    @model_validator(mode="after")
    def _one_size(self) -> "ConcealedEffect":
        given = [key for key in ("amplitude", "displacement") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ProblemAtError(
                (),
                f"has {' and '.join(given) or 'none'} of amplitude, displacement; give exactly one of them",
            )
        return self


class DiverseCommands(Model):
    """Scripted hits of the domain, without latents."""

    diverse: ScriptedHits = Field(description="what they are drawn from")


class StandIns(Model):
    """Stand-in rigs, and how a session with them is recorded."""

    hits: Annotated[int, Field(ge=1, le=100_000)] = Field(description="of each object")
    repeats: Repeats = Field(description="commands that are executed several times")
    objects: Annotated[dict[Name, RigObject], Field(min_length=1, max_length=100)] = Field(
        description="object_id -> object"
    )
    scale_sd_kg: Scatter = Field(description="error of the scale that weighs the objects")
    blade: Blade | None = Field(description="a blade that bends; null for the scene's rigid one")
    board: Board | None = Field(description="an uneven board; null for a flat one")
    friction_field: FrictionField | None = Field(
        description="friction that differs from place to place; null for the same everywhere"
    )
    scatter: HitScatter = Field(description="what differs from hit to hit, as standard deviations")
    camera: Camera = Field(description="the ceiling camera")
    joints: Joints = Field(description="the recording of the arm")
    concealed: Annotated[list[ConcealedEffect], Field(max_length=100)] = Field(
        description="physics that the rig conceals beside the blocks above; each kind at most once"
    )
    commands: Literal["latents", "pool"] | DiverseCommands = Field(
        description="latents of the trajectory model, commands that other sessions draw from as well, or "
        "scripted hits of the domain without latents"
    )
    keep: Keep = Field(description="which tables the recording holds")

    @model_validator(mode="after")
    def _possible(self) -> "StandIns":
        repeats, kinds = self.repeats, [effect.kind for effect in self.concealed]
        if repeats.hits > self.hits:
            raise ProblemAtError(
                ("repeats",),
                f"{repeats.commands} commands x {repeats.times} times are more than hits = {self.hits}; "
                "lower the first two or raise the last",
            )
        for i, effect in enumerate(self.concealed):
            at = ("concealed", i)
            if effect.kind in kinds[:i]:
                raise ProblemAtError(at, f"{effect.kind} stands twice; give it once, with a larger amplitude")
            if effect.kind == "compliant_blade" and self.blade is not None:
                raise ProblemAtError(at, "compliant_blade and `blade` bend the same blade; set blade to null")
            if effect.displacement is not None and self.scatter.nothing:
                raise ProblemAtError(at, "a displacement needs scatter to be measured by; give an amplitude")
        return self


class Lab(StandIns):
    """Settings of stand-in rigs."""

    commands: Literal["latents"] | DiverseCommands = Field(
        description="latents of the trajectory model, or scripted hits of the domain without latents"
    )


class SharedCommands(Model):
    """Demonstrations that commands are drawn from, as they were made."""

    count: Count
    duration_s: Duration


class LabSettings(Model):
    """What the stage `lab` is told, and the stage `case`, whose commands come from a pool."""

    seed: Annotated[int, Field(ge=0)]
    rig: Annotated[int, Field(ge=0)]
    scene: Scene
    lab: StandIns
    trajectory_model_id: MayMiss[str] = None
    pool: MayMiss[SharedCommands] = None
