"""Conversion of a URDF for MuJoCo's reader, without meshes and conventions of other programs."""

import re
from xml.etree import ElementTree

_COMPILER = {
    "discardvisual": "true",
    # MuJoCo merges what is fixed to the world, and merges names with it, unless it is told not to.
    "fusestatic": "false",
    "inertiafromgeom": "auto",
    "balanceinertia": "true",
    "strippath": "true",
}
_WORLD = "world"
# Comments may hold anything, and MuJoCo reads some that the standard forbids.
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_ROBOT_FIRST = re.compile(r"\ufeff?\s*(?:<[?!][^>]*>\s*)*<robot[\s>]")


def is_urdf(text: str) -> bool:
    """Whether an XML text is of a URDF robot."""
    return _ROBOT_FIRST.match(_COMMENT.sub("", text)) is not None


def readable_urdf(text: str) -> str:
    """The same robot for MuJoCo's reader.

    Visuals and collision meshes are removed: they do not affect the motion without contact, and mesh files
        are
    often missing. The link `world` is added where it is only named, as Drake allows.

    Raises:
        ElementTree.ParseError: the text is no XML.
    """
    robot = ElementTree.fromstring(_COMMENT.sub("", text))
    for link in robot.iter("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            if part.tag == "visual" or part.find("geometry/mesh") is not None:
                link.remove(part)
    for joint in robot.iter("joint"):
        axis = joint.find("axis")
        if axis is not None and not any(float(number) for number in axis.get("xyz", "1 0 0").split()):
            joint.remove(axis)  # of fixed joints, which need none
    links = {link.get("name") for link in robot.findall("link")}
    parents = {parent.get("link") for parent in robot.findall("joint/parent")}
    if _WORLD in parents - links:
        ElementTree.SubElement(robot, "link", name=_WORLD)
    mujoco = robot.find("mujoco")
    if mujoco is None:
        mujoco = ElementTree.SubElement(robot, "mujoco")
    compiler = mujoco.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(mujoco, "compiler")
    compiler.attrib.update(_COMPILER)
    return ElementTree.tostring(robot, encoding="unicode")
