"""Off-centre mass: the object's centre of mass is not its middle."""

from collections.abc import Mapping

import mujoco

from slapshot.arrays import Array
from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo


class OffcentreMass(Effect):
    name = "offcentre_mass"
    phase = "slide"
    follows = "spin"
    parameters = (
        Parameter("offset_x", "m", -0.02, 0.02, 0.003, "centre of mass ahead of the middle before the hit"),
        Parameter("offset_y", "m", -0.02, 0.02, 0.003, "centre of mass to the left of the middle before it"),
    )
    physics = (
        "A hit through the middle misses the centre of mass and makes the object spin; it then turns about\n"
        "its centre of mass, of which the camera sees the middle go round, and presses harder on one side."
    )
    source = "Goyal, Ruina and Papadopoulos 1991, Wear 143 (non-uniform pressure under a slider)"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Move the body's inertial frame; mass and moment about the centre of mass stay."""
        model = spec.compile()
        compiled = model.body(info.object_body)
        body = spec.body(info.object_body)
        body.explicitinertial = True
        body.mass = float(compiled.mass[0])
        body.inertia = compiled.inertia
        body.iquat = compiled.iquat
        x, y, z = compiled.ipos
        body.ipos = (x + values["offset_x"], y + values["offset_y"], z)

    def centre_offset(self, values: Mapping[str, Array]) -> tuple[Array, Array]:
        """In the frame of the object."""
        return values["offset_x"], values["offset_y"]
