"""A joint split into motor and link, with a compliant element in between.

A second joint on the same axis is added to the link's body. The first keeps its actuators, friction and rotor
inertia and is the motor; the second is the deflection of the link relative to it.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, RigMotion

# Fastest mode that a time step of 1 ms can simulate with some margin, in rad/s.
FASTEST = 400.0
AT_MOTOR, AT_LINK = "read at the motor", "read at the link"


def deflection(joint: str) -> str:
    """Name of the second joint."""
    return f"slapshot:deflection:{joint}"


class SplitJoint(JointEffect):
    """An effect of a joint that is split in two, whose encoder sits at either of them."""

    hidden_state = True

    def __init__(self, joint: Joint, variant: str, *parameters: Parameter) -> None:
        super().__init__(joint.name, parameters, variant)
        self._joint = joint

    @property
    def reads_link(self) -> bool:
        """Whether the encoder is on the link side."""
        return self.variant == AT_LINK

    @property
    def added_joint(self) -> str:
        """The deflection joint."""
        return deflection(self.part)

    def restructure(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Split the joint."""
        split_joint(spec, self.part, 0.1 * self._joint.inertia)
        return spec

    def static_deflection(self, load: Array) -> Array:
        """Static deflection of the link under a load (N m or N)."""
        raise NotImplementedError

    def note(self, values: Array) -> str:
        """The encoder's reading, where it differs from the original joint."""
        if not self.reads_link:
            return ""
        both = f"joints {self.part} and deflection:{self.part}"
        return f"The encoder of joint {self.part} reads the sum of {both}."


def split_joints(rig: RigMotion) -> Iterator[Joint]:
    """Driven joints that can be split: the last of their bodies, whose deflection moves the link alone."""
    model = rig.model
    own = [j for j in range(model.njnt) if not model.joint(j).name.startswith("slapshot:")]
    last = {int(model.jnt_bodyid[j]): j for j in own}
    for joint in rig.joints:
        j = int(model.dof_jntid[joint.v])
        if joint.actuators and last.get(int(model.jnt_bodyid[j])) == j:
            yield joint


def split_joint(spec: mujoco.MjSpec, joint: str, rotor: float) -> None:
    """Add the second joint.

    Args:
        spec: is changed.
        joint: name of a hinge or slide.
        rotor: inertia that the motor gets where the model gives it none; without, it could not be simulated.
    """
    motor = spec.joint(joint)
    added = motor.parent.add_joint(
        name=deflection(joint), type=motor.type, axis=motor.axis, pos=motor.pos, stiffness=0, damping=0
    )
    if motor.frame is not None:
        added.set_frame(motor.frame)
    # Nothing from the model's defaults, which are of its own joints.
    added.armature = added.frictionloss = added.ref = added.springref = 0.0
    added.limited = added.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    if motor.armature <= 0:
        motor.armature = rotor


def stiffest(joint: Joint, armature: float) -> float:
    """Stiffness at which motor and link vibrate at the fastest mode that can be simulated, N m/rad or N/m."""
    rotor = armature if armature > 0 else 0.1 * joint.inertia
    link = max(joint.inertia - armature, 1e-3 * joint.inertia)
    return FASTEST**2 * rotor * link / (rotor + link)


def base_joint(axis: str) -> str:
    """Name of the joint by which the base tilts about an axis."""
    return f"slapshot:base:{axis}"


def put_on_base(spec: mujoco.MjSpec, inertia: float) -> mujoco.MjSpec:
    """The model on a plate that tilts about the world's x and y axes through its foot.

    Args:
        spec: of a robot that stands on the world.
        inertia: of the plate, kg m^2.
    """
    whole = spec.copy()
    resolve_files(whole)
    whole.compile()
    root = ElementTree.fromstring(whole.to_xml())
    world = root.find("worldbody")
    if world is None:
        raise ValueError("the model has no world")
    standing = [
        child for child in world if child.tag in ("body", "frame") and child.find(".//joint") is not None
    ]
    if not standing:
        raise ValueError("no body stands on the world and moves")
    foot = _place(standing[0])
    plate = ElementTree.SubElement(world, "body", name="slapshot:base", pos=_written(foot))
    diagonal = _written(np.full(3, inertia))
    ElementTree.SubElement(plate, "inertial", pos="0 0 0", mass=repr(inertia), diaginertia=diagonal)
    for axis, along in (("x", "1 0 0"), ("y", "0 1 0")):
        plain = dict.fromkeys(("stiffness", "damping", "armature", "frictionloss", "ref", "springref"), "0")
        free = {"limited": "false", "actuatorfrclimited": "false"}
        ElementTree.SubElement(plate, "joint", plain | free, name=base_joint(axis), type="hinge", axis=along)
    for body in standing:
        body.set("pos", _written(_place(body) - foot))
        world.remove(body)
        plate.append(body)
    return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"), assets=dict(spec.assets))


def resolve_files(spec: mujoco.MjSpec) -> None:
    """Name the folders of meshes and textures in full, for a model that is written and read elsewhere."""
    if spec.modelfiledir and (spec.meshes or spec.textures or spec.hfields or spec.skins):
        base = Path(spec.modelfiledir)
        spec.meshdir = str((base / spec.meshdir).resolve())
        spec.texturedir = str((base / spec.texturedir).resolve())


def _place(body: ElementTree.Element) -> np.ndarray:
    return np.array([float(x) for x in body.get("pos", "0 0 0").split()])


def _written(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
