"""Concealed in the camera: what it makes of places and times."""

from typing import Any

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.concealed.hidden_effect import HiddenEffect, NominalMotion, Shape

_FOOT_SD = 0.12  # m, along x and y, by which a camera looks past the point it is meant to look at


class CameraScale(HiddenEffect):
    """A metre in the recording is none: places are stretched about a point near the camera's foot."""

    name = "camera_scale"
    phase = "camera"
    like = "same"
    unit, amplitude, usual, largest = "1", "size of the logarithm of reported over true length", 0.03, 0.3

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {"sign": float(rng.choice((-1.0, 1.0))), "about_m": _near_foot(setting, rng)}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"log_scale": shape["sign"] * amplitude}

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        about = np.array(shape["about_m"])
        return about + np.exp(shape["sign"] * amplitude) * (places - about)


class CameraRotation(HiddenEffect):
    """The camera is mounted askew: places are turned about a point near its foot."""

    name = "camera_rotation"
    phase = "camera"
    like = "same"
    unit, amplitude, usual, largest = "rad", "size of the angle", 0.03, 0.3

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {"sign": float(rng.choice((-1.0, 1.0))), "about_m": _near_foot(setting, rng)}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"angle": shape["sign"] * amplitude}

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        about, angle = np.array(shape["about_m"]), shape["sign"] * amplitude
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return about + (places - about) @ turn.T


class CameraTime(HiddenEffect):
    """The camera's clock is late, by a little more or less as the session goes on."""

    name = "camera_time"
    phase = "camera"
    like = "same"
    unit, amplitude, usual, largest = "s", "mean delay", 0.02, 0.08
    shows = "track"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {"drift_share": float(rng.uniform(-0.3, 0.3))}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"delay": amplitude}

    def camera_delay(self, amplitude: float, shape: Shape, place: float) -> float:
        return amplitude * (1 + shape["drift_share"] * (place - 0.5))


class LensDistortion(HiddenEffect):
    """A lens that was not calibrated: r becomes r (1 + k1 r^2 + k2 r^4), r from a point near the foot."""

    name = "lens_distortion"
    phase = "camera"
    unit, amplitude, usual, largest = "1/m^2", "size of k1", 0.015, 0.1

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {
            "sign": float(rng.choice((-1.0, 1.0))),
            "k2_share_per_m2": float(rng.uniform(-0.15, 0.15)),
            "about_m": _near_foot(setting, rng),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"radial": shape["sign"] * amplitude}

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        about = np.array(shape["about_m"])
        out = places - about
        square = (out**2).sum(1, keepdims=True)
        k1 = shape["sign"] * amplitude
        return about + out * (1 + k1 * square * (1 + shape["k2_share_per_m2"] * square))


def _near_foot(setting: NominalMotion, rng: np.random.Generator) -> list[float]:
    return (setting.foot + rng.normal(0, _FOOT_SD, 2)).tolist()
