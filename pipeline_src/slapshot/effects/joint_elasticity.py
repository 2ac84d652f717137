"""Joint elasticity: gears and shafts of the arm twist between motor and link."""

from collections.abc import Mapping

import mujoco

from slapshot.effects.effect import ARM_JOINTS, Effect, Parameter
from slapshot.scenes.scene import SceneInfo

# s, damping over stiffness: what loads slowly is hardly damped (3 % of critical at 10 Hz), and a spring of
# any stiffness stays stable at steps of integration below twice this.
RETARDATION = 1e-3


class JointElasticity(Effect):
    name = "joint_elasticity"
    phase = "swing"
    follows = "command"
    parameters = tuple(
        Parameter(f"twist_{j + 1}", "rad", 0.0, 0.2, 0.004, "twist of one joint at its torque limit")
        for j in range(ARM_JOINTS)
    )
    physics = (
        "A damped spring between motor (servo, encoder, rotor) and link of each joint. Links swing against\n"
        "their encoders and yield to the impact."
    )
    source = "Spong 1987, Modeling and control of elastic joint robots (J. Dyn. Sys., Meas., Control 109)"

    def edit(self, values: Mapping[str, float], spec: mujoco.MjSpec, info: SceneInfo) -> None:
        """Add joints `<joint>_twist`; motor angles stay the scene's joints, links turn by both."""
        for parameter, name, limit in zip(self.parameters, info.joints, info.torque_limits, strict=False):
            if values[parameter.name] > 0:
                stiffness = limit / values[parameter.name]
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
