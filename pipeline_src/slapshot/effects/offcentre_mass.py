"""Off-centre mass: the object's centre of mass is not its middle."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo

LEAST_OFFSET = 1e-3  # m: what moves the centre of mass by less is no slug, whatever it does to inertia


class OffcentreMass(Effect):
    name = "offcentre_mass"
    phase = "slide"
    follows = "spin"
    parameters = (
        Parameter("offset_x", "m", -0.02, 0.02, 0.003, "centre of mass ahead of the middle before the hit"),
        Parameter("offset_y", "m", -0.02, 0.02, 0.003, "centre of mass to the left of the middle before it"),
        Parameter("log_inertia", "1", -2.0, 1.0, 0.4, "log of the moment of inertia over that of a disc"),
    )
    physics = (
        "A hit through the middle makes the object spin; it then turns about its centre of mass and presses\n"
        "harder on one side. What moves the centre of mass (a slug) changes the moment of inertia as well."
    )
    source = "Goyal, Ruina and Papadopoulos 1991, Wear 143 (non-uniform pressure under a slider)"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Move the body's inertial frame; its mass stays."""
        model = spec.compile()
        compiled = model.body(info.object_body)
        body = spec.body(info.object_body)
        body.explicitinertial = True
        body.mass = float(compiled.mass[0])
        body.inertia = compiled.inertia * np.exp(float(_moved_log_inertia(values)))
        body.iquat = compiled.iquat
        x, y, z = compiled.ipos
        body.ipos = (x + values["offset_x"], y + values["offset_y"], z)

    def centre_offset(self, values: Mapping[str, Array]) -> tuple[Array, Array]:
        """In the frame of the object."""
        return values["offset_x"], values["offset_y"]

    def log_inertia(self, values: Mapping[str, Array]) -> Array:
        """About the centre of mass."""
        return _moved_log_inertia(values)


def _moved_log_inertia(values: Mapping[str, Any]) -> Array:
    """Log of the factor on inertia: none while the centre of mass is where it was."""
    offset = np.hypot(values["offset_x"], values["offset_y"])
    return np.asarray(values["log_inertia"] * -np.expm1(-((offset / LEAST_OFFSET) ** 2)))
