"""A rig: a MuJoCo model, and which recorded channel is which part of it.

Controls go to actuators, or as a torque or force to a joint without one (which gets a motor). Observations are
sensors that are added to the model: what a simulation step returns beside the next state.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from slapshot.errors import InputError
from slapshot.recordings.signals import Channel
from slapshot.text import reason_of

# Names of what is added to a user's model; stripped from models that are written.
OWN = "slapshot:"
_COMPONENTS = {"x": 0, "y": 1, "z": 2, "qw": 0, "qx": 1, "qy": 2, "qz": 3}
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class Control:
    """What drives an actuator: a recorded channel, times a factor, or nothing (0)."""

    actuator: str
    channel: str | None
    factor: float = 1.0


@dataclass(frozen=True)
class Observation:
    """What a recorded channel observes.

    Attributes:
        channel: its name.
        address: in the model's sensor data.
        quantity: position, velocity, torque or force.
        dof: index in qvel of the joint that is observed; None for others.
        part: name of the joint, site, body or sensor.
    """

    channel: str
    address: int
    quantity: str
    dof: int | None
    part: str


@dataclass(frozen=True)
class Rig:
    """A nominal model and its bindings.

    Attributes:
        name: for the report.
        spec: as the user gave it, with motors for torques that are recorded of joints, without sensors.
        model: compiled, with the sensors of `observations`.
        controls: one for each actuator, in the model's order.
        observations: in the order of the columns of recorded data.
        free: names of effects (`name` or `name@part`) that belong to the nominal model: refitted with every
            hypothesis.
        load: addresses of the sensors that tell each dof's actuator force; -1 for those of free and ball joints.
    """

    name: str
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    controls: tuple[Control, ...]
    observations: tuple[Observation, ...]
    free: tuple[str, ...]
    load: np.ndarray


def load_spec(file: Path) -> mujoco.MjSpec:
    """A model from an MJCF or URDF file; meshes that a URDF names and that are not there are left out.

    Raises:
        InputError: it is missing or does not compile.
    """
    if not file.is_file():
        raise InputError(f"{file}: model is missing; name an MJCF or URDF file")
    text = file.read_text(errors="replace")
    is_urdf = re.search(r"<robot[\s>]", text) is not None
    try:
        if is_urdf:
            # What a robot looks like does not move it, and mesh files seldom travel with a recording.
            text = re.sub(r"<visual>.*?</visual>", "", text, flags=re.S)
            # MuJoCo merges what is fixed to the world, and merges names with it, unless it is told not to.
            text = re.sub(
                r"(<robot[^>]*>)", r'\1<mujoco><compiler discardvisual="true" fusestatic="false" '
                r'inertiafromgeom="auto" balanceinertia="true" strippath="true"/></mujoco>', text, count=1
            )  # fmt: skip
            text = re.sub(r'<axis xyz="0 0 0"\s*/>', "", text)
            spec = mujoco.MjSpec.from_string(text)
        else:
            spec = mujoco.MjSpec.from_file(str(file))
        spec.copy().compile()
    except Exception as error:  # MuJoCo raises what it likes
        raise InputError(f"{file}: does not compile ({reason_of(error)}); correct the model") from None
    return spec


def bind(
    spec: mujoco.MjSpec, channels: Mapping[str, Channel], name: str = "rig", free: Sequence[str] = ()
) -> Rig:
    """Bind channels to the parts of a model that they name.

    Raises:
        InputError: a channel names what the model does not have, or nothing is observed; one line.
    """
    spec = spec.copy()
    _name_all(spec)
    model = spec.copy().compile()
    bound: dict[str, Control] = {}
    for channel_name, channel in channels.items():
        if channel.role == "control":
            actuator = _actuator(spec, model, channel_name, channel)
            if actuator in bound:
                raise InputError(
                    f"channels: {bound[actuator].channel} and {channel_name} both drive {actuator}; keep one"
                )
            bound[actuator] = Control(actuator, channel_name)
    plain = spec.copy()
    sensed, added = spec, []
    for body in sensed.bodies:
        # A load may move the centre of any body; MuJoCo else compiles balanced ones so that it cannot.
        body.simple = False
    for channel_name, channel in channels.items():
        if channel.role == "observation":
            added.append((channel_name, channel, *_sensor(sensed, model, channel_name, channel)))
    if not added:
        raise InputError("channels: nothing is observed; record joint positions at least")
    for j in range(model.njnt):
        if model.jnt_type[j] in _SCALAR:
            joint = model.joint(j).name
            sensed.add_sensor(
                name=f"{OWN}load:{joint}",
                type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint,
            )
    compiled = sensed.compile()
    observations = []
    for channel_name, channel, sensor, component in added:
        joint = channel.joint
        dof = None
        if joint is not None and compiled.joint(joint).type[0] in _SCALAR:
            dof = int(compiled.joint(joint).dofadr[0])
        address = int(compiled.sensor(sensor).adr[0]) + component
        part = joint or channel.site or channel.body or channel.sensor or channel.actuator or channel_name
        observations.append(Observation(channel_name, address, channel.quantity, dof, part))
    load = np.full(compiled.nv, -1)
    for j in range(compiled.njnt):
        if compiled.jnt_type[j] in _SCALAR:
            sensor = compiled.sensor(f"{OWN}load:{compiled.joint(j).name}")
            load[compiled.jnt_dofadr[j]] = sensor.adr[0]
    names = [compiled.actuator(i).name for i in range(compiled.nu)]
    controls = tuple(bound.get(actuator, Control(actuator, None)) for actuator in names)
    return Rig(name, plain, compiled, controls, tuple(observations), tuple(free), load)


def _name_all(spec: mujoco.MjSpec) -> None:
    """Name bodies, joints and actuators without a name, for what is said of them."""
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("actuator", spec.actuators)):
        taken = {element.name for element in elements}
        for i, element in enumerate(elements):
            if not element.name:
                name = f"{kind} {i}"
                element.name = name if name not in taken else f"{name} without a name"


def _names(model: mujoco.MjModel, kind: str) -> list[str]:
    count = {"joint": model.njnt, "actuator": model.nu, "sensor": model.nsensor}
    count |= {"site": model.nsite, "body": model.nbody}
    return [getattr(model, kind)(i).name for i in range(count[kind])]


def _check(model: mujoco.MjModel, kind: str, part: str, channel: str) -> None:
    known = [name for name in _names(model, kind) if name]
    if part not in known:
        raise InputError(
            f"channel {channel}: the model has no {kind} {part!r}; it has: {', '.join(known) or 'none'}"
        )


def _actuator(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, channel: Channel) -> str:
    """The actuator that a control drives; a motor is added for the torque of a joint."""
    if channel.actuator is not None:
        _check(model, "actuator", channel.actuator, name)
        return channel.actuator
    if channel.joint is None:
        _check(model, "actuator", name, name)
        return name
    _check(model, "joint", channel.joint, name)
    if channel.quantity not in ("torque", "force"):
        raise InputError(
            f"channel {name}: controls joint {channel.joint} with a {channel.quantity}; name the actuator "
            "that it is told to, or record the torque"
        )
    motor = f"{OWN}{channel.joint}"
    added = spec.add_actuator(name=motor, target=channel.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    added.set_to_motor()
    return motor


def _sensor(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, channel: Channel) -> tuple[str, int]:
    """Name of the sensor that a channel stands for, and which of its numbers."""
    component = _COMPONENTS.get(channel.component or "x", 0)
    if channel.sensor is not None:
        _check(model, "sensor", channel.sensor, name)
        return channel.sensor, component
    if channel.joint is None and channel.site is None and channel.body is None and channel.actuator is None:
        _check(model, "sensor", name, name)
        return name, component
    turned = (channel.component or "").startswith("q")
    own = OWN + name
    types, objects = mujoco.mjtSensor, mujoco.mjtObj
    if channel.joint is not None:
        _check(model, "joint", channel.joint, name)
        joint = model.joint(channel.joint)
        if joint.type[0] not in _SCALAR:
            body = model.body(int(joint.bodyid[0])).name
            return _frame(spec, own, channel.quantity, objects.mjOBJ_XBODY, body, turned), component
        kind = {
            "position": types.mjSENS_JOINTPOS,
            "velocity": types.mjSENS_JOINTVEL,
            "torque": types.mjSENS_JOINTACTFRC,
            "force": types.mjSENS_JOINTACTFRC,
        }[channel.quantity]
        spec.add_sensor(name=own, type=kind, objtype=objects.mjOBJ_JOINT, objname=channel.joint)
        return own, 0
    if channel.actuator is not None:
        _check(model, "actuator", channel.actuator, name)
        kind = {
            "position": types.mjSENS_ACTUATORPOS,
            "velocity": types.mjSENS_ACTUATORVEL,
            "torque": types.mjSENS_ACTUATORFRC,
            "force": types.mjSENS_ACTUATORFRC,
        }[channel.quantity]
        spec.add_sensor(name=own, type=kind, objtype=objects.mjOBJ_ACTUATOR, objname=channel.actuator)
        return own, 0
    if channel.site is not None:
        _check(model, "site", channel.site, name)
        return _frame(spec, own, channel.quantity, objects.mjOBJ_SITE, channel.site, turned), component
    assert channel.body is not None
    _check(model, "body", channel.body, name)
    return _frame(spec, own, channel.quantity, objects.mjOBJ_XBODY, channel.body, turned), component


def _frame(spec: mujoco.MjSpec, own: str, quantity: str, kind: mujoco.mjtObj, part: str, turned: bool) -> str:
    types = mujoco.mjtSensor
    if quantity == "position":
        sensor = types.mjSENS_FRAMEQUAT if turned else types.mjSENS_FRAMEPOS
    else:
        sensor = types.mjSENS_FRAMELINVEL
    spec.add_sensor(name=own, type=sensor, objtype=kind, objname=part)
    return own
