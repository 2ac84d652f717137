"""A load that the model does not carry."""

from collections.abc import Iterator

import mujoco

from slapshot.effects.joints.effect import Array, JointEffect, Parameter, Situation
from slapshot.effects.joints.parts import add_point_mass, far_end, moving_bodies


class Payload(JointEffect):
    name = "payload"
    physics = "A compact mass is fixed to a link, at a place of its own."
    source = "Atkeson, An, Hollerbach (1986), International Journal of Robotics Research 5(3)"
    phrase = "a load on {part}"

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["Payload"]:
        """One a link that carries no other; prior: a fifth of its mass, at its far end, within its length."""
        model = rig.model
        carrying = {int(model.body_parentid[body]) for body in moving_bodies(model)}
        for body in moving_bodies(model):
            if body in carrying and len(moving_bodies(model)) > 1:
                continue
            end, length = far_end(model, body)
            scale = 0.2 * float(model.body_mass[body])
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
