"""Mass error of a link."""

from collections.abc import Iterator

import mujoco

from slapshot.arrays import Array
from slapshot.effects.joints.effect import JointEffect, Parameter, RigMotion
from slapshot.effects.joints.parts import moving_bodies


class LinkMass(JointEffect):
    name = "link_mass"
    physics = "Mass and inertia of a link differ from the model's by one factor."
    source = "Atkeson, An, Hollerbach (1986), International Journal of Robotics Research 5(3)"
    phrase = "mass of {part}"

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["LinkMass"]:
        """One for each moving body with a relevant mass; prior: a quarter of it."""
        for body in moving_bodies(rig.model):
            name = rig.model.body(body).name
            yield cls(name, body, Parameter("excess", "1", 0.25, low=-0.95, probe=1e-3))

    def __init__(self, part: str, body: int, parameter: Parameter) -> None:
        super().__init__(part, (parameter,))
        self._body = body

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Scale mass and inertia."""
        model.body_mass[self._body] *= 1 + values[0]
        model.body_inertia[self._body] *= 1 + values[0]
