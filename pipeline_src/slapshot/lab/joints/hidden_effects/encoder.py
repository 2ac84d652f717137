"""Concealed in what is recorded of a joint; the rig itself moves as believed.

Recorded is an encoder of its own on the link. What a servo or a controller reads is another one, and right.
"""

from typing import Any

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
    """A radian in the recording is none, and a disc that is mounted out of centre adds a wave a turn."""

    name = "encoder_scale"
    unit, amplitude = "1", "size of what is added to a scale of 1"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {
            "joint": draw_joint(setting.rig, rng),
            "sign": draw_sign(rng),
            "eccentric_share": float(rng.uniform(0.0, 0.1)),
            "phase_rad": float(rng.uniform(0, 2 * np.pi)),
        }

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(0.01, 0.0, 0.5)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"scale": (1 + shape["sign"] * amplitude, "1")}

    def read(self, amplitude: float, shape: Shape, angles: Array) -> Array:
        phase = shape["phase_rad"]
        wave = shape["eccentric_share"] * (np.sin(angles + phase) - np.sin(phase))
        return angles + shape["sign"] * amplitude * (angles + wave)


class EncoderDelay(HiddenEffect):
    """What is recorded is old, by a little more or less as time goes on."""

    name = "encoder_delay"
    unit, amplitude = "s", "mean delay"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {
            "joint": draw_joint(setting.rig, rng),
            "wander_share": float(rng.uniform(0.0, 0.15)),
            "wander_hz": float(rng.uniform(0.2, 1.0)),
        }

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
        return Bounds(3e-3, 0.0, 0.1)

    def parameters(self, amplitude: float, shape: Shape) -> dict[str, tuple[float, str]]:
        return {"delay": (amplitude, "s")}

    def when(self, amplitude: float, shape: Shape, times: Array) -> Array:
        wander = shape["wander_share"] * np.sin(2 * np.pi * shape["wander_hz"] * times)
        return times - amplitude * (1 + wander)


class StickySensor(HiddenEffect):
    """An encoder that repeats its last value until the angle has changed by more than so much.

    No effect that rigs usually conceal is like it.
    """

    name = "sticky_sensor"
    catalogued = False
    unit, amplitude = "rad", "change that it takes"

    def draw(self, setting: NominalMotion, rng: np.random.Generator) -> dict[str, Any]:
        return {"joint": draw_joint(setting.rig, rng)}

    def bounds(self, setting: NominalMotion, shape: Shape) -> Bounds:
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
