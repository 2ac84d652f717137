"""Joint elasticity: gears and shafts of the arm twist between motor and link."""

from collections.abc import Mapping

import mujoco

from slapshot.effects.effect import Effect, Parameter
from slapshot.scenes.scene import SceneInfo

# s, damping over stiffness: what loads slowly is hardly damped (3 % of critical at 10 Hz), and a spring of
# any stiffness stays stable at steps of integration below twice this.
RETARDATION = 1e-3


class JointElasticity(Effect):
    name = "joint_elasticity"
    phase = "swing"
    follows = "command"
    parameters = (
        Parameter("compliance", "rad/(N m)", 0.0, 1e-3, 2e-5, "twist over torque of the strongest joint"),
    )
    physics = (
        "A damped spring between motor (servo, encoder, rotor) and link of every joint; all twist alike at\n"
        "their torque limits. Links swing against their encoders and yield to the impact."
    )
    source = "Spong 1987, Modeling and control of elastic joint robots (J. Dyn. Sys., Meas., Control 109)"
    known_to = 0.3  # joints of one arm differ, and have one value here

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Add joints `<joint>_twist`; motor angles stay the scene's joints, links turn by both."""
        compliance = values["compliance"]
        if compliance == 0:
            return
        for name, limit in zip(info.joints, info.torque_limits, strict=True):
            stiffness = limit / max(info.torque_limits) / compliance
            twist = add_behind_motor(spec, name, f"{name}_twist")
            twist.stiffness = (stiffness, 0, 0)
            twist.damping = (RETARDATION * stiffness, 0, 0)


def add_behind_motor(spec: mujoco.MjSpec, name: str, new: str) -> mujoco.MjsJoint:
    """A joint on the same axis as joint `name`, between its motor and its link.

    Both joints turn one body, so that its inertia is moved by their sum, while armature, servo and encoder
    belong to `name` alone: motor and link without a body in between.
    """
    motor = spec.joint(name)
    return motor.parent.add_joint(
        name=new,
        type=motor.type,
        axis=motor.axis,
        pos=motor.pos,
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
        actfrclimited=mujoco.mjtLimited.mjLIMITED_FALSE,
        armature=0.0,
        damping=0.0,
        frictionloss=0.0,
    )
