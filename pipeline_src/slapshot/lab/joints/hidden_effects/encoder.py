"""Hidden effects of the recorded encoder; the rig itself moves nominally.

The recorded encoder sits on the link. Servo and controller read another one, which is correct.
"""

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.joints.hidden_effect import (
    Bounds,
    HiddenEffect,
    NominalMotion,
    Shape,
    draw_joint,
    draw_sign,
)


class EncoderScale(HiddenEffect):
    """Scale error of the encoder, and eccentricity with one period per turn."""

    name = "encoder_scale"
    unit, amplitude = "1", "size of what is added to a scale of 1"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "joint": draw_joint(nominal.rig, rng),
            "sign": draw_sign(rng),
            "eccentric_share": float(rng.uniform(0.0, 0.1)),
            "phase_rad": float(rng.uniform(0, 2 * np.pi)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.01, 0.0, 0.5)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"scale": (1 + shape["sign"] * amplitude, "1")}

    def read(self, amplitude: float, shape: Shape, angles: Array) -> Array:
        phase = shape["phase_rad"]
        wave = shape["eccentric_share"] * (np.sin(angles + phase) - np.sin(phase))
        return angles + shape["sign"] * amplitude * (angles + wave)


class EncoderDelay(HiddenEffect):
    """Delay of the readings, which varies slowly."""

    name = "encoder_delay"
    unit, amplitude = "s", "mean delay"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {
            "joint": draw_joint(nominal.rig, rng),
            "wander_share": float(rng.uniform(0.0, 0.15)),
            "wander_hz": float(rng.uniform(0.2, 1.0)),
        }

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(3e-3, 0.0, 0.1)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"delay": (amplitude, "s")}

    def when(self, amplitude: float, shape: Shape, times: Array) -> Array:
        wander = shape["wander_share"] * np.sin(2 * np.pi * shape["wander_hz"] * times)
        return times - amplitude * (1 + wander)


class StickySensor(HiddenEffect):
    """An encoder that repeats its last value until the angle has changed by a threshold.

    It has no counterpart in the catalogue.
    """

    name = "sticky_sensor"
    catalogued = False
    unit, amplitude = "rad", "change that it takes"

    def draw(self, nominal: NominalMotion, rng: np.random.Generator) -> Shape:
        return {"joint": draw_joint(nominal.rig, rng)}

    def bounds(self, nominal: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(2e-3, 0.0, 0.5)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"threshold": (amplitude, "rad")}

    def read(self, amplitude: float, shape: Shape, angles: Array) -> Array:
        read = angles.copy()
        last = read[:, 0].copy()
        for own in read.T:
            np.copyto(last, own, where=np.abs(own - last) > amplitude)
            own[:] = last
        return read
