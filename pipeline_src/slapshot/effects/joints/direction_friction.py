"""Direction-dependent dry friction."""

from collections.abc import Iterator

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint
from slapshot.effects.joints.parts import add_friction


class DirectionFriction(JointEffect):
    name = "direction_friction"
    physics = (
        "Preload or a worn flank makes dry friction larger in one direction than in the other; so does a "
        "constant torque beside it (the offset of a drive)."
    )
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
    phrase = "friction at {part} that differs between directions"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["DirectionFriction"]:
        """One for each joint; prior: in each direction as dry friction."""
        for joint in rig.joints:
            yield cls(joint, rig.model)

    def __init__(self, joint: Joint, model: mujoco.MjModel) -> None:
        scale = 0.3 * joint.torque
        way = {"low": -float(model.dof_frictionloss[joint.v]), "probe": 1e-3 * scale}
        super().__init__(
            joint.name,
            [Parameter(name, joint.unit, scale, **way) for name in ("forward", "backward")],
        )
        self._joint = joint

    def describes(self, values: Array) -> bool:
        """Whether there is friction in both directions; otherwise a constant torque pushes in one of them."""
        return all(value > p.low + 1e-9 * p.scale for value, p in zip(values, self.parameters, strict=True))

    def edit(self, model: mujoco.MjModel, values: Array) -> None:
        """Add the mean of both directions to the joint's friction loss."""
        add_friction(model, self._joint.v, (values[0] + values[1]) / 2)

    def force(self, state: State, values: Array) -> Array:
        """Half the difference, towards negative.

        Beside friction of the mean size, this is exact in motion and at rest: friction then holds up to its
        size in either direction.
        """
        half = np.full(len(state.v), (values[0] - values[1]) / 2)
        return on_joint(self._joint, -half, state.v.shape[1])

    def note(self, values: Array) -> str:
        """The constant part."""
        return self._joint.note(
            f"a constant {-(values[0] - values[1]) / 2:.4g}, which makes the friction loss in the model "
            "larger in one direction than in the other"
        )

    def same_as(self, values: Array) -> str:
        """Friction of the mean size beside a constant force, such as the offset of a drive."""
        unit = self._joint.unit
        return (
            f"Coulomb friction of {(values[0] + values[1]) / 2:.3g} {unit} and a constant offset of "
            f"{-(values[0] - values[1]) / 2:.3g} {unit}"
        )
