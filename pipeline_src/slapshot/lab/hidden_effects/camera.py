"""Hidden effects of the camera: distorted positions and delayed times."""

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.hidden_effects.hidden_effect import HiddenEffect, NominalMotion, Shape

_FOOT_SD = 0.12  # m, along x and y, by which a camera misses its nominal target point


class CameraScale(HiddenEffect):
    """Scale error: positions are scaled about a point near the camera's foot."""

    name = "camera_scale"
    phase = "camera"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = (
        "1",
        "size of the logarithm of reported over true length",
        0.03,
        0.3,
    )

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"sign": float(rng.choice((-1.0, 1.0))), "about_m": _near_foot(nominal, rng)}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"log_scale": shape["sign"] * amplitude}

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        about = np.array(shape["about_m"])
        return about + np.exp(shape["sign"] * amplitude) * (places - about)


class CameraRotation(HiddenEffect):
    """Mounting error: positions are rotated about a point near the camera's foot."""

    name = "camera_rotation"
    phase = "camera"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = "rad", "size of the angle", 0.03, 0.3

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"sign": float(rng.choice((-1.0, 1.0))), "about_m": _near_foot(nominal, rng)}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"angle": shape["sign"] * amplitude}

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        about, angle = np.array(shape["about_m"]), shape["sign"] * amplitude
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return about + (places - about) @ turn.T


class CameraTime(HiddenEffect):
    """Delay of the camera, which drifts slightly over the session."""

    name = "camera_time"
    phase = "camera"
    parameter_match = "same"
    unit, amplitude, typical_amplitude, max_amplitude = "s", "mean delay", 0.02, 0.08
    observed_in = "track"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"drift_share": float(rng.uniform(-0.3, 0.3))}

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"delay": amplitude}

    def camera_delay(self, amplitude: float, shape: Shape, place: float) -> float:
        return amplitude * (1 + shape["drift_share"] * (place - 0.5))


class LensDistortion(HiddenEffect):
    """Radial lens distortion: r becomes r (1 + k1 r^2 + k2 r^4), r from a point near the foot."""

    name = "lens_distortion"
    phase = "camera"
    unit, amplitude, typical_amplitude, max_amplitude = "1/m^2", "size of k1", 0.015, 0.1

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "sign": float(rng.choice((-1.0, 1.0))),
            "k2_share_per_m2": float(rng.uniform(-0.15, 0.15)),
            "about_m": _near_foot(nominal, rng),
        }

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, float]:
        return {"radial": shape["sign"] * amplitude}

    def see(self, amplitude: float, shape: Shape, places: Array) -> Array:
        about = np.array(shape["about_m"])
        out = places - about
        square = (out**2).sum(1, keepdims=True)
        k1 = shape["sign"] * amplitude
        return about + out * (1 + k1 * square * (1 + shape["k2_share_per_m2"] * square))


def _near_foot(nominal: NominalMotion, rng: np.random.Generator) -> list[float]:
    return (nominal.foot + rng.normal(0, _FOOT_SD, 2)).tolist()
