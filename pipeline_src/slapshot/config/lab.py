"""Block `lab` of a recording: the stand-in rigs and how they are recorded."""

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

_LEAST_FRAMES = 4  # of an object at rest; with fewer, the rest point may not be observed

# In the order of slapshot.lab.hidden_effects.registry, which is not imported to validate a configuration.
ConcealedKind = Literal[
    "command_delay", "tracking_lag", "servo_gain", "joint_elasticity", "backlash", "crooked_arm",
    "compliant_blade", "restitution", "blade_friction", "blade_yaw", "curved_blade",
    "tilt", "uneven_board", "place_friction", "linear_drag", "quadratic_drag", "stribeck_friction",
    "turned_anisotropy", "curl", "offcentre_mass", "attracting_spot", "tether", "pulsing_fan",
    "friction_drift", "camera_scale", "camera_rotation", "camera_time", "lens_distortion",
]  # fmt: skip
Keep = Literal["full", "no encoders", "tracks only", "rest points only"]


class Repeats(Model):
    """Commands that are executed several times, which shows the hit-to-hit variation."""

    commands: Annotated[int, Field(ge=0, le=10_000)] = Field(description="number of repeated commands")
    times: Annotated[int, Field(ge=0, le=10_000)] = Field(
        description="executions of each repeated command with each object"
    )

    @property
    def hits(self) -> int:
        """Number of repeated hits of each object."""
        return self.commands * self.times


class RigObject(Model):
    """An object to hit."""

    mass_kg: Range[Mass] = Field(description="kg")
    friction_x: Range[PositiveCoefficient] = Field(description="of object and board, along x")
    friction_ratio: Range[PositiveRatio] = Field(description="friction along y over that along x")
    friction_torsional_m: Range[Coefficient] = Field(description="m, of object and board")


class Blade(Model):
    """A flexible blade."""

    segments: Annotated[int, Field(ge=2, le=100)] = Field(description="rigid segments joined by hinges")
    stiffness_nm_rad: Range[Stiffness] = Field(description="N m/rad, of all hinges in series")
    twist_stiffness_nm_rad: Range[Stiffness] | None = Field(
        description="N m/rad; null for a blade that does not twist"
    )
    damping_ratio: Range[Ratio] = Field(description="of the blade's free vibration")


class Board(Model):
    """An uneven board."""

    rms_slope: Range[Share] = Field(description="m/m")
    wavelength_m: Interval[Length] = Field(description="shortest and longest")
    waves: Few = Field(description="number of waves, in all directions")


class FrictionField(Model):
    """Friction that varies over the board."""

    rms: Range[Coefficient] = Field(description="of the logarithm of friction")
    wavelength_m: Interval[Length] = Field(description="shortest and longest")
    waves: Few = Field(description="number of waves, in all directions")


class HitScatter(Model):
    """Standard deviations of the hit-to-hit variation."""

    start_error_sd_m: Scatter = Field(description="of the object's start, along x and along y")
    speed_sd: Scatter = Field(description="of the logarithm of the factor on the speed of execution")
    joint_offset_sd_rad: Annotated[list[Scatter], Field(max_length=100)] = Field(description="of each joint")
    friction_sd: Scatter = Field(description="of the logarithm of friction")

    @property
    def nothing(self) -> bool:
        """Whether all executions of a command are identical."""
        return not any((self.start_error_sd_m, self.speed_sd, self.friction_sd, *self.joint_offset_sd_rad))


class Camera(Model):
    """The ceiling camera."""

    rate_hz: Rate = Field(description="frames per second")
    noise_sd_m: Scatter = Field(description="along x and along y")
    noise_time_s: Annotated[float, Field(ge=0, le=60)] = Field(
        description="correlation time of the noise; 0 for white noise"
    )
    stamp_jitter_share: Annotated[float, Field(ge=0, le=0.2)] = Field(
        description="standard deviation of the frames' time stamps over the interval between frames"
    )
    outlier_share: Share = Field(description="share of frames whose noise is larger, see slapshot.lab.camera")
    missing_share: Annotated[float, Field(ge=0, lt=1)] = Field(description="share of frames that are lost")
    mistrack_share: Share = Field(description="share of frames in which something else is tracked")
    mistrack_m: Interval[Distance] = Field(description="smallest and largest error of such a frame")
    after_rest_s: Duration = Field(description="recording time after the object has come to rest")
    view_m: Box | None = Field(description="lowest x, highest x, lowest y, highest y; null for no limit")
    yaw_sd_rad: Scatter | None = Field(description="noise of the object's yaw; null where it is not recorded")

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
    """Recording of the arm's joints."""

    rate_hz: Rate = Field(description="sampling rate of commands and encoder readings")
    noise_sd_rad: Scatter = Field(description="of the encoders")


class ConcealedEffect(Model):
    """A hidden effect of the rig, with its size given directly or by its influence."""

    kind: ConcealedKind = Field(description="see slapshot.lab.hidden_effects")
    amplitude: MayMiss[Range[Ratio]] = Field(default=None, description="in the unit of the effect")
    displacement: MayMiss[Range[PositiveRatio]] = Field(
        default=None, description="rms shift of rest points, or of tracks, relative to the hit-to-hit scatter"
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

    diverse: ScriptedHits = Field(description="ranges that they are drawn from")


class StandIns(Model):
    """Stand-in rigs, and how a session with them is recorded."""

    hits: Annotated[int, Field(ge=1, le=100_000)] = Field(description="number of hits of each object")
    repeats: Repeats = Field(description="commands that are executed several times")
    objects: Annotated[dict[Name, RigObject], Field(min_length=1, max_length=100)] = Field(
        description="object_id -> object"
    )
    scale_sd_kg: Scatter = Field(description="standard error of the scale that weighs the objects")
    blade: Blade | None = Field(description="a flexible blade; null for the scene's rigid one")
    board: Board | None = Field(description="an uneven board; null for a flat one")
    friction_field: FrictionField | None = Field(
        description="friction that varies over the board; null for uniform friction"
    )
    scatter: HitScatter = Field(description="standard deviations of the hit-to-hit variation")
    camera: Camera = Field(description="the ceiling camera")
    joints: Joints = Field(description="recording of the arm's joints")
    concealed: Annotated[list[ConcealedEffect], Field(max_length=100)] = Field(
        description="hidden effects in addition to the blocks above; each kind at most once"
    )
    commands: Literal["latents", "pool"] | DiverseCommands = Field(
        description="latents of the trajectory model, commands from a pool that sessions share, or scripted "
        "hits of the domain without latents"
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
    """Number and duration of the demonstrations in the pool that commands are drawn from."""

    count: Count
    duration_s: Duration


class LabSettings(Model):
    """Settings of the stage `lab`, and of the stage `case`, whose commands come from a pool."""

    seed: Annotated[int, Field(ge=0)]
    rig: Annotated[int, Field(ge=0)]
    scene: Scene
    lab: StandIns
    trajectory_model_id: MayMiss[str] = None
    pool: MayMiss[SharedCommands] = None
