"""Ground truth of a rig: everything that a recording does not contain and a diagnosis has to infer.

A value in the settings is either a fixed number or a range [low, high] from which it is drawn uniformly.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, partial

import numpy as np

from slapshot.arrays import Array
from slapshot.config.lab import Blade, Board, FrictionField, RigObject, StandIns
from slapshot.json_types import JsonObject
from slapshot.lab.blade import Edit
from slapshot.lab.blade_truth import BladeTruth
from slapshot.lab.board import FLAT, draw_height, draw_log_friction
from slapshot.lab.executed_trajectory import Filter
from slapshot.lab.hidden_effects.hidden_effect import Concealed
from slapshot.lab.ranges import draw_number, pair_of
from slapshot.lab.surface import Ground


@dataclass(frozen=True)
class ObjectTruth:
    """True parameters of an object.

    Attributes:
        mass: kg.
        friction_x, friction_y: coefficients between object and board along the world's axes.
        friction_torsional: m.
    """

    mass: float
    friction_x: float
    friction_y: float
    friction_torsional: float


@dataclass(frozen=True)
class Scatter:
    """Standard deviations of the hit-to-hit variation.

    Attributes:
        start_error_sd: m, along x and along y, of the object's position before the hit.
        speed_sd: of the logarithm of the factor on the speed of execution.
        joint_offset_sd: (joints,) rad, of the offset that each joint has at the motion's end.
        friction_sd: of the logarithm of the object's friction on the board.
    """

    start_error_sd: float
    speed_sd: float
    joint_offset_sd: tuple[float, ...]
    friction_sd: float


@dataclass(frozen=True)
class Camera:
    """The ceiling camera.

    Attributes:
        rate: frames a second.
        noise_sd: m, along x and along y.
        noise_time: s, correlation time of the noise; 0 for white noise.
        stamp_jitter: standard deviation of time stamps over the interval between frames.
        outlier_share: share of frames whose noise is larger.
        missing_share: share of frames that are lost.
        mistrack_share: share of frames in which something else is taken for the object.
        mistrack: smallest and largest error in m of such a frame.
        after_rest: s that the camera continues to record once the object rests.
        view: lowest x, highest x, lowest y, highest y in m of the field of view; None for no limit.
        yaw_sd: rad; None where yaw is not recorded.
    """

    rate: float
    noise_sd: float
    noise_time: float
    stamp_jitter: float
    outlier_share: float
    missing_share: float
    mistrack_share: float
    mistrack: tuple[float, float]
    after_rest: float
    view: tuple[float, float, float, float] | None
    yaw_sd: float | None = None


@dataclass(frozen=True, eq=False)
class Rig:
    """Ground truth of a rig.

    Attributes:
        objects: object_id -> object.
        blade: None for the scene's own rigid blade.
        height: (waves, 4) height field of the board, see `board`; no rows for a flat board.
        log_friction: (waves, 4) field of log friction over the board.
        scatter: hit-to-hit variation.
        camera: the ceiling camera.
        concealed: further hidden effects.
    """

    objects: Mapping[str, ObjectTruth]
    blade: BladeTruth | None
    height: Array
    log_friction: Array
    scatter: Scatter
    camera: Camera
    concealed: tuple[Concealed, ...] = ()

    @cached_property
    def acting(self) -> tuple[Concealed, ...]:
        """Hidden effects with a nonzero amplitude."""
        return tuple(c for c in self.concealed if c.amplitude != 0)

    @property
    def striker(self) -> BladeTruth | None:
        """Flexibility of the striker; None for a rigid one."""
        found = [c.effect.blade(c.amplitude, c.shape) for c in self.acting]
        return next((blade for blade in found if blade is not None), self.blade)

    @property
    def edits(self) -> list[Edit]:
        """Changes of the scene's model."""
        return [partial(c.effect.edit, c.amplitude, c.shape) for c in self.acting if c.effect.has("edit")]

    @property
    def filters(self) -> list[Filter]:
        """Filters that are applied to the commands."""
        return [partial(c.effect.follow, c.amplitude, c.shape) for c in self.acting if c.effect.has("follow")]

    @property
    def ground(self) -> Ground:
        """Forces and friction that act on sliding objects."""
        ground = Ground(height=self.height, log_friction=self.log_friction)
        for c in self.acting:
            ground = c.effect.ground(c.amplitude, c.shape, ground)
        return ground

    def delay(self, quirk: Mapping[str, float]) -> float:
        """Delay of the commands of a hit in s; `quirk`: hidden effect -> a standard normal number."""
        return sum(c.effect.delay(c.amplitude, c.shape, quirk.get(c.effect.name, 0.0)) for c in self.acting)

    @property
    def settling(self) -> float:
        """S that the filters' output continues to change after the last command."""
        return sum(c.effect.settling(c.amplitude, c.shape) for c in self.acting)

    def yaw(self, quirk: Mapping[str, float]) -> float:
        """Yaw of the object before a hit, in rad."""
        return sum(c.effect.yaw(c.amplitude, c.shape, quirk.get(c.effect.name, 0.0)) for c in self.acting)

    def friction_factor(self, place: float) -> float:
        """Factor on friction at a position within the session, from 0 to 1."""
        return float(np.exp(sum(c.effect.log_friction(c.amplitude, c.shape, place) for c in self.acting)))

    @property
    def bounces(self) -> bool:
        """Whether the contact parameters of striker and object differ from the scene's."""
        return any(c.effect.has("bounce") for c in self.acting)

    def bounce(self, solref: Array, speed: float) -> Array:
        """Time constant and damping ratio (2,) of that contact at the striker's speed in m/s."""
        for c in self.acting:
            solref = c.effect.bounce(c.amplitude, c.shape, solref, speed)
        return solref

    def seen(self, track: Array, place: float) -> Array:
        """A track (n, 3 or more) t, x, y with the camera's systematic errors and without noise."""
        seen = track[:, :3].copy()
        for c in self.acting:
            seen[:, 0] += c.effect.camera_delay(c.amplitude, c.shape, place)
            seen[:, 1:] = c.effect.see(c.amplitude, c.shape, seen[:, 1:])
        return seen


def draw_rig(settings: StandIns, rng: np.random.Generator) -> Rig:
    """Draw the values for which the settings (block `lab` of the configuration) give ranges.

    Every part has its own random stream, so that removing the blade does not change the board.
    """
    streams = rng.spawn(4)
    objects = {
        name: _draw_object(spec, stream)
        for (name, spec), stream in zip(
            settings.objects.items(), streams[0].spawn(len(settings.objects)), strict=True
        )
    }
    scatter, camera = settings.scatter, settings.camera
    return Rig(
        objects=objects,
        blade=_draw_blade(settings.blade, streams[1]),
        height=_draw_height(settings.board, streams[2]),
        log_friction=_draw_log_friction(settings.friction_field, streams[3]),
        scatter=Scatter(
            start_error_sd=scatter.start_error_sd_m,
            speed_sd=scatter.speed_sd,
            joint_offset_sd=tuple(scatter.joint_offset_sd_rad),
            friction_sd=scatter.friction_sd,
        ),
        camera=Camera(
            rate=camera.rate_hz,
            noise_sd=camera.noise_sd_m,
            noise_time=camera.noise_time_s,
            stamp_jitter=camera.stamp_jitter_share,
            outlier_share=camera.outlier_share,
            missing_share=camera.missing_share,
            mistrack_share=camera.mistrack_share,
            mistrack=(camera.mistrack_m[0], camera.mistrack_m[1]),
            after_rest=camera.after_rest_s,
            view=_view(camera.view_m),
            yaw_sd=camera.yaw_sd_rad,
        ),
    )


def truth_dict(rig: Rig) -> JsonObject:
    """The rig as plain lists and numbers, for JSON; units as in the classes above."""
    return {
        "objects": {name: asdict(truth) for name, truth in rig.objects.items()},
        "blade": None if rig.blade is None else asdict(rig.blade),
        "board_height_m": rig.height.tolist(),
        "board_log_friction": rig.log_friction.tolist(),
        "field_columns": ["kx_rad_m", "ky_rad_m", "amplitude", "phase_rad"],
        "scatter": asdict(rig.scatter),
        "camera": asdict(rig.camera),
    }


def _view(box: list[float] | None) -> tuple[float, float, float, float] | None:
    return None if box is None else (box[0], box[1], box[2], box[3])


def _draw_object(spec: RigObject, rng: np.random.Generator) -> ObjectTruth:
    friction_x = draw_number(spec.friction_x, rng)
    return ObjectTruth(
        mass=draw_number(spec.mass_kg, rng),
        friction_x=friction_x,
        friction_y=friction_x * draw_number(spec.friction_ratio, rng),
        friction_torsional=draw_number(spec.friction_torsional_m, rng),
    )


def _draw_blade(spec: Blade | None, rng: np.random.Generator) -> BladeTruth | None:
    if spec is None:
        return None
    twist = spec.twist_stiffness_nm_rad
    return BladeTruth(
        segments=spec.segments,
        stiffness=draw_number(spec.stiffness_nm_rad, rng),
        twist_stiffness=None if twist is None else draw_number(twist, rng),
        damping_ratio=draw_number(spec.damping_ratio, rng),
    )


def _draw_height(spec: Board | None, rng: np.random.Generator) -> Array:
    if spec is None:
        return FLAT
    rms = draw_number(spec.rms_slope, rng)
    return draw_height(rms, pair_of(spec.wavelength_m), spec.waves, rng)


def _draw_log_friction(spec: FrictionField | None, rng: np.random.Generator) -> Array:
    if spec is None:
        return FLAT
    rms = draw_number(spec.rms, rng)
    wavelengths = pair_of(spec.wavelength_m)
    return draw_log_friction(rms, wavelengths, spec.waves, rng)
