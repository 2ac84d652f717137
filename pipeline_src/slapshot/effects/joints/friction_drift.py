"""Drift of friction over the session."""

from collections.abc import Iterator

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion, State, on_joint


class FrictionDrift(JointEffect):
    name = "friction_drift"
    physics = (
        "A cold joint is stiff at the session's start and runs itself warm: lubricant thins as it heats up."
    )
    source = "Bittencourt, Gunnarsson (2012), ASME J. of Dynamic Systems, Measurement, and Control 134(5)"
    phrase = "friction at {part} that drifts over the session"
    empirical = True
    friction = True

    @classmethod
    def instances(cls, rig: RigMotion) -> Iterator["FrictionDrift"]:
        """One for each joint, from five episodes on; prior: a sixth of the usual torque."""
        if rig.episodes < 5:
            return
        for joint in rig.joints:
            dry = 0.15 * joint.torque
            wet = dry / joint.speed
            yield cls(
                joint,
                Parameter("dry", joint.unit, dry, probe=0.01 * dry),
                Parameter("viscous", f"{joint.unit} s/{joint.angle_unit}", wet, probe=0.01 * wet),
                Parameter("warm", "1", 0.3, start=0.2, low=0.0, high=3.0),
                Parameter("warms_in", "1", 0.2, start=0.3, low=0.05, high=2.0),
                # Grease creeps where dry bodies stick.
                Parameter(
                    "slides_at",
                    f"{joint.angle_unit}/s",
                    0.1 * joint.speed,
                    2 * joint.step_speed,
                    joint.step_speed,
                    joint.speed,
                ),
            )

    def __init__(self, joint: Joint, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters)
        self._joint = joint

    def force(self, state: State, values: Array) -> Array:
        """Friction of the first episode, which decays exponentially to a share of it."""
        j = self._joint
        v = state.v[:, j.v]
        dry, viscous, warm, warms_in, slides_at = values
        level = warm + (1 - warm) * np.exp(-(state.order + 0.5) / warms_in)
        return on_joint(j, -level * (dry * np.tanh(v / slides_at) + viscous * v), state.v.shape[1])

    def note(self, values: Array) -> str:
        """The law, and how it goes over the session."""
        j, (dry, viscous, warm, warms_in, slides_at) = self._joint, values
        return j.note(
            f"-({warm:.4g} + {1 - warm:.4g} exp(-p / {warms_in:.4g})) "
            f"({dry:.4g} tanh(v / {slides_at:.4g}) + {viscous:.4g} v), "
            "where p goes evenly from 0 in the first episode to 1 in the last"
        )
