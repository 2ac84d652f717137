"""Unmodelled payload."""

from collections.abc import Iterator

import mujoco

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import add_point_mass, carriers, far_end, moving_bodies

_SLIDES = 2  # of body_simple: where its mass is does not matter


class Payload(JointEffect):
    name = "payload"
    physics = "A compact mass is fixed to a link, at a place of its own."
    source = "Atkeson, An, Hollerbach (1986), International Journal of Robotics Research 5(3)"
    phrase = "a load on {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["Payload"]:
        """One for each link that carries no other; one that flies or slides freely would only be heavier.

        Prior: a fifth of the mass of the arm that carries it, at the link's far end, within its length.
        """
        model = rig.model
        bodies, free = moving_bodies(model), {body for body, _ in rig.free_bodies}
        carrying = {carrier for body in bodies for carrier in carriers(model, body)[1:]}
        for body in bodies:
            if body in carrying or body in free or model.body_simple[body] == _SLIDES:
                continue
            end, length = far_end(model, body)
            scale = 0.2 * sum(float(model.body_mass[b]) for b in carriers(model, body) if b in bodies)
            yield cls(
                model.body(body).name,
                body,
                Parameter("mass", "kg", scale, low=0.0, probe=0.01 * scale),
                *(Parameter(axis, "m", 0.3 * length, float(at)) for axis, at in zip("xyz", end, strict=True)),
            )

    def __init__(self, part: str, body: int, *parameters: Parameter) -> None:
        super().__init__(part, parameters)
        self._body = body

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add a point mass to the body."""
        add_point_mass(model, self._body, float(values[0]), values[1:4])
