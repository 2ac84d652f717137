"""Friction that changes over the session."""

from collections.abc import Iterator

import numpy as np

from slapshot.effects.joints.effect import Array, Joint, JointEffect, Parameter, Situation, State, on_joint


class FrictionDrift(JointEffect):
    name = "friction_drift"
    physics = "Bearings warm up, and lubricant thins: friction changes from the first episode to the last."
    source = "Bittencourt, Gunnarsson (2012), ASME J. of Dynamic Systems, Measurement, and Control 134(5)"
    phrase = "friction at {part} that drifts over the session"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: Situation) -> Iterator["FrictionDrift"]:
        """One a joint and kind of friction, from five episodes on; prior: a sixth of the usual torque."""
        if rig.episodes < 5:
            return
        for joint in rig.joints:
            dry = 0.15 * joint.torque
            wet = dry / joint.speed
            yield cls(
                joint,
                Parameter("dry", joint.unit, dry, probe=0.01 * dry),
                Parameter("viscous", f"{joint.unit} s/{joint.angle_unit}", wet, probe=0.01 * wet),
            )

    def __init__(self, joint: Joint, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters)
        self._joint = joint

    def force(self, state: State, values: Array) -> Array:
        """Growth of friction from the first episode to the last, about the middle."""
        j = self._joint
        v = state.v[:, j.v]
        friction = values[0] * np.tanh(v / j.step_speed) + values[1] * v
        return on_joint(j, -state.order * friction, state.v.shape[1])

    def note(self, values: Array) -> str:
        """The law, and how it goes over the session."""
        j = self._joint
        return j.note(
            f"-p ({values[0]:.4g} tanh(v / {j.step_speed:.4g}) + {values[1]:.4g} v), where p goes evenly "
            "from -1/2 in the first episode to 1/2 in the last"
        )
