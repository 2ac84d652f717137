"""Sensors for observed channels.

A hinge, slide or actuator reads one number. A ball joint reads its own quaternion and angular velocity, as
qpos and qvel have them; sites, bodies and free joints read place, quaternion and velocities in the world
frame.
"""

import mujoco

from slapshot.errors import InputError
from slapshot.recordings.channels import QUATERNION, Channel

# Names of what is added to a user's model; stripped from models that are written.
OWN = "slapshot:"
_COMPONENTS = {"x": 0, "y": 1, "z": 2, "qw": 0, "qx": 1, "qy": 2, "qz": 3}
_SENSOR, _OBJECT, _JOINT = mujoco.mjtSensor, mujoco.mjtObj, mujoco.mjtJoint
SCALAR = (int(_JOINT.mjJNT_HINGE), int(_JOINT.mjJNT_SLIDE))
_OF_JOINT = {
    "position": _SENSOR.mjSENS_JOINTPOS,
    "velocity": _SENSOR.mjSENS_JOINTVEL,
    "torque": _SENSOR.mjSENS_JOINTACTFRC,
    "force": _SENSOR.mjSENS_JOINTACTFRC,
}
_OF_ACTUATOR = {
    "position": _SENSOR.mjSENS_ACTUATORPOS,
    "velocity": _SENSOR.mjSENS_ACTUATORVEL,
    "torque": _SENSOR.mjSENS_ACTUATORFRC,
    "force": _SENSOR.mjSENS_ACTUATORFRC,
}


def check_part(model: mujoco.MjModel, kind: str, part: str, channel: str) -> None:
    """Refuse a channel of a joint, actuator, sensor, site or body that the model does not have.

    Raises:
        InputError: one line that names those it has.
    """
    count = {"joint": model.njnt, "actuator": model.nu, "sensor": model.nsensor}
    count |= {"site": model.nsite, "body": model.nbody}
    known = [name for i in range(count[kind]) if (name := getattr(model, kind)(i).name)]
    if part not in known:
        raise InputError(
            f"channel {channel}: the model has no {kind} {part!r}; it has: {', '.join(known) or 'none'}"
        )


def check_joint_unit(model: mujoco.MjModel, name: str, channel: Channel) -> None:
    """Refuse lengths of a hinge, and angles of a slide.

    Raises:
        InputError: one line.
    """
    turns = model.joint(channel.joint).type[0] == int(_JOINT.mjJNT_HINGE)
    units = ("rad", "rad/s", "N m") if turns else ("m", "m/s", "N")
    if channel.unit not in units:
        raise InputError(
            f"channel {name}: unit {channel.unit!r} cannot be of joint {channel.joint}, a "
            f"{'hinge' if turns else 'slide'}, whose units are {', '.join(units)}; convert it, or name the "
            "part that was recorded"
        )


def add_sensor(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, channel: Channel) -> tuple[str, int]:
    """Add a sensor for a channel, if the model has none.

    Args:
        spec: which gets it.
        model: compiled from `spec` before.
        name: of the channel.
        channel: an observation.

    Returns:
        Name of the sensor, and which of its numbers it is.

    Raises:
        InputError: the model does not have what is observed; one line.
    """
    if channel.target is None or channel.sensor is not None:
        return _own_sensor(model, name, channel)
    kind, part = channel.target
    check_part(model, kind, part, name)
    component = channel.component
    if kind == "actuator" or (kind == "joint" and model.joint(part).type[0] in SCALAR):
        table, object_type = (
            (_OF_JOINT, _OBJECT.mjOBJ_JOINT) if kind == "joint" else (_OF_ACTUATOR, _OBJECT.mjOBJ_ACTUATOR)
        )
        if channel.quantity not in table:
            raise InputError(
                f"channel {name}: a {channel.quantity} is an input, not an observation; make it a control"
            )
        if component is not None:
            raise InputError(f"channel {name}: {kind} {part} has one number; remove component {component!r}")
        if kind == "joint":
            check_joint_unit(model, name, channel)
        sensor = table[channel.quantity]
    elif kind == "joint" and model.joint(part).type[0] == _JOINT.mjJNT_BALL:
        sensor, object_type = _of_ball(name, channel), _OBJECT.mjOBJ_JOINT
    else:
        sensor, object_type = _of_frame(name, channel), _OBJECT.mjOBJ_XBODY
        if kind == "site":
            object_type = _OBJECT.mjOBJ_SITE
        elif kind == "joint":
            part = model.body(int(model.joint(part).bodyid[0])).name
    spec.add_sensor(name=OWN + name, type=sensor, objtype=object_type, objname=part)
    return OWN + name, _COMPONENTS[component or "x"]


def _own_sensor(model: mujoco.MjModel, name: str, channel: Channel) -> tuple[str, int]:
    sensor, component = channel.sensor or name, channel.component
    check_part(model, "sensor", sensor, name)
    size = int(model.sensor(sensor).dim[0])
    if (component is None) != (size == 1) or _COMPONENTS[component or "x"] >= size:
        numbers = "one number" if size == 1 else f"{size} numbers"
        raise InputError(
            f"channel {name}: sensor {sensor} has {numbers}, and component is {component!r}; "
            + ("remove it" if size == 1 else "say which it is")
        )
    return sensor, _COMPONENTS[component or "x"]


def _of_ball(name: str, channel: Channel) -> mujoco.mjtSensor:
    if channel.component in QUATERNION:
        return _SENSOR.mjSENS_BALLQUAT
    if channel.component is not None and channel.unit == "rad/s":
        return _SENSOR.mjSENS_BALLANGVEL
    raise InputError(
        f"channel {name}: ball joint {channel.joint} has a quaternion (qw to qz) and an angular velocity "
        f"(x, y, z in rad/s), not a {channel.quantity} in {channel.unit}; name the body"
    )


def _of_frame(name: str, channel: Channel) -> mujoco.mjtSensor:
    target = " ".join(channel.target or ())
    if channel.quantity not in ("position", "velocity"):
        raise InputError(
            f"channel {name}: a {channel.quantity} at {target} needs a sensor; add one to the model, and "
            "name it"
        )
    if channel.component is None:
        raise InputError(f"channel {name}: {target} has several numbers; say which component it is")
    if channel.quantity == "position":
        turned = channel.component in QUATERNION
        return _SENSOR.mjSENS_FRAMEQUAT if turned else _SENSOR.mjSENS_FRAMEPOS
    turned = channel.unit == "rad/s"
    return _SENSOR.mjSENS_FRAMEANGVEL if turned else _SENSOR.mjSENS_FRAMELINVEL
