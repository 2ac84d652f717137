"""A joint split in two: motor and link, with something that gives way between them.

A second joint on the same axis is added to the link's body. The first keeps its actuators, friction and rotor
inertia and is the motor; the second is by how much the link stands ahead of it.
"""

import mujoco

from slapshot.effects.joints.effect import Joint

# Of the fastest mode that a time step of 1 ms can hold with some margin, in rad/s.
_FASTEST = 400.0


def deflection(joint: str) -> str:
    """Name of the second joint."""
    return f"slapshot:deflection:{joint}"


def split_joint(spec: mujoco.MjSpec, joint: str, rotor: float) -> None:
    """Add the second joint.

    Args:
        spec: is changed.
        joint: name of a hinge or slide.
        rotor: inertia that the motor gets where the model gives it none; without, it could not be simulated.
    """
    motor = spec.joint(joint)
    motor.parent.add_joint(
        name=deflection(joint), type=motor.type, axis=motor.axis, pos=motor.pos, stiffness=0, damping=0
    )
    if motor.armature <= 0:
        motor.armature = rotor


def stiffest(joint: Joint, armature: float) -> float:
    """Stiffness at which motor and link vibrate against one another as fast as can be simulated, N m/rad or N/m."""
    rotor = armature if armature > 0 else 0.1 * joint.inertia
    link = max(joint.inertia - armature, 1e-3 * joint.inertia)
    return _FASTEST**2 * rotor * link / (rotor + link)
