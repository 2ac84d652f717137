"""What a rig conceals: everything that a recording does not say and a diagnosis must find out.

A value in the settings is either a number, which is taken as it is, or [low, high], between which it is
drawn uniformly.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slapshot.errors import InputError
from slapshot.lab.board import FLAT, draw_height, draw_log_friction

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObjectTruth:
    """An object as it is.

    Attributes:
        mass: kg.
        friction_x, friction_y: of object and board, along the world's axes.
        friction_torsional: m.
    """

    mass: float
    friction_x: float
    friction_y: float
    friction_torsional: float


@dataclass(frozen=True)
class BladeTruth:
    """A flexible striker.

    Attributes:
        segments: rigid pieces across its height, the first of which sits on the stick.
        stiffness: N m/rad, of all hinges in series, bending backwards about the blade's long axis.
        twist_stiffness: N m/rad, of all hinges in series, about the stick's axis; None for none.
        damping_ratio: of the blade swinging freely on all its hinges as one.
    """

    segments: int
    stiffness: float
    twist_stiffness: float | None
    damping_ratio: float


@dataclass(frozen=True)
class Scatter:
    """What differs from hit to hit.

    Attributes:
        start_error_sd: m, along x and along y, of where the object lies before the hit.
        speed_sd: of the logarithm of the pace at which a motion is executed.
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
        noise_time: s, over which the noise of successive frames is alike; 0 for white noise.
        missing_share: of frames that are lost.
        mistrack_share: of frames in which something else is taken for the object.
        mistrack: nearest and farthest in m that such a frame is off.
        after_rest: s that the camera goes on recording once the object rests.
        view: lowest x, highest x, lowest y, highest y in m of what the camera sees; None for all.
    """

    rate: float
    noise_sd: float
    noise_time: float
    missing_share: float
    mistrack_share: float
    mistrack: tuple[float, float]
    after_rest: float
    view: tuple[float, float, float, float] | None


@dataclass(frozen=True, eq=False)
class Rig:
    """The truth about a rig.

    Attributes:
        objects: object_id -> object.
        blade: None for the scene's own rigid one.
        height: (waves, 4) of the board, see `board`; no rows for a flat one.
        log_friction: (waves, 4), by which friction differs from place to place.
        scatter: from hit to hit.
        camera: that looks on.
    """

    objects: Mapping[str, ObjectTruth]
    blade: BladeTruth | None
    height: Array
    log_friction: Array
    scatter: Scatter
    camera: Camera


def draw_rig(settings: Mapping[str, Any], rng: np.random.Generator) -> Rig:
    """Draw what the settings (block `lab` of the configuration) leave open.

    Every part has its own stream of random numbers: to take away the blade leaves the board as it is.

    Raises:
        InputError: a range runs backwards.
    """
    streams = rng.spawn(4)
    objects = {
        name: _draw_object(spec, f"objects.{name}", stream)
        for (name, spec), stream in zip(
            settings["objects"].items(), streams[0].spawn(len(settings["objects"])), strict=True
        )
    }
    scatter, camera = settings["scatter"], settings["camera"]
    return Rig(
        objects=objects,
        blade=_draw_blade(settings["blade"], streams[1]),
        height=_draw_height(settings["board"], streams[2]),
        log_friction=_draw_log_friction(settings["friction_field"], streams[3]),
        scatter=Scatter(
            start_error_sd=scatter["start_error_sd_m"],
            speed_sd=scatter["speed_sd"],
            joint_offset_sd=tuple(scatter["joint_offset_sd_rad"]),
            friction_sd=scatter["friction_sd"],
        ),
        camera=Camera(
            rate=camera["rate_hz"],
            noise_sd=camera["noise_sd_m"],
            noise_time=camera["noise_time_s"],
            missing_share=camera["missing_share"],
            mistrack_share=camera["mistrack_share"],
            mistrack=(camera["mistrack_m"][0], camera["mistrack_m"][1]),
            after_rest=camera["after_rest_s"],
            view=None if camera["view_m"] is None else tuple(camera["view_m"]),
        ),
    )


def truth_dict(rig: Rig) -> dict[str, Any]:
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


def _draw_object(spec: Mapping[str, Any], key: str, rng: np.random.Generator) -> ObjectTruth:
    friction_x = _draw(spec["friction_x"], f"{key}.friction_x", rng)
    return ObjectTruth(
        mass=_draw(spec["mass_kg"], f"{key}.mass_kg", rng),
        friction_x=friction_x,
        friction_y=friction_x * _draw(spec["friction_ratio"], f"{key}.friction_ratio", rng),
        friction_torsional=_draw(spec["friction_torsional_m"], f"{key}.friction_torsional_m", rng),
    )


def _draw_blade(spec: Mapping[str, Any] | None, rng: np.random.Generator) -> BladeTruth | None:
    if spec is None:
        return None
    twist = spec["twist_stiffness_nm_rad"]
    return BladeTruth(
        segments=spec["segments"],
        stiffness=_draw(spec["stiffness_nm_rad"], "blade.stiffness_nm_rad", rng),
        twist_stiffness=None if twist is None else _draw(twist, "blade.twist_stiffness_nm_rad", rng),
        damping_ratio=_draw(spec["damping_ratio"], "blade.damping_ratio", rng),
    )


def _draw_height(spec: Mapping[str, Any] | None, rng: np.random.Generator) -> Array:
    if spec is None:
        return FLAT
    rms = _draw(spec["rms_slope"], "board.rms_slope", rng)
    return draw_height(rms, _pair(spec["wavelength_m"], "board.wavelength_m"), spec["waves"], rng)


def _draw_log_friction(spec: Mapping[str, Any] | None, rng: np.random.Generator) -> Array:
    if spec is None:
        return FLAT
    rms = _draw(spec["rms"], "friction_field.rms", rng)
    wavelengths = _pair(spec["wavelength_m"], "friction_field.wavelength_m")
    return draw_log_friction(rms, wavelengths, spec["waves"], rng)


def _draw(value: float | list[float], key: str, rng: np.random.Generator) -> float:
    if isinstance(value, int | float):
        return float(value)
    return float(rng.uniform(*_pair(value, key)))


def _pair(value: list[float], key: str) -> tuple[float, float]:
    low, high = value
    if low > high:
        raise InputError(f"lab.{key}: {value} runs backwards; write [low, high] with low <= high")
    return float(low), float(high)
