"""A rig: a MuJoCo model with recorded channels bound to its parts.

Controls go to actuators, as a torque or force to a joint without one (which gets a motor), or as a pose to a
mocap body. Observations are sensors that are added to the model: what a simulation step returns beside the
next state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from slapshot.diagnosis.model.sensors import OWN, SCALAR, add_sensor, check_joint_unit, check_part
from slapshot.diagnosis.model.urdf import is_urdf, readable_urdf
from slapshot.errors import InputError
from slapshot.recordings.channels import PLACE, QUATERNION, Channel
from slapshot.text import reason_of

_QUATERNIONS = (int(mujoco.mjtSensor.mjSENS_FRAMEQUAT), int(mujoco.mjtSensor.mjSENS_BALLQUAT))


@dataclass(frozen=True)
class Control:
    """Binding of an input of the model.

    Attributes:
        input: name of an actuator, or of a mocap body and a component of its pose.
        channel: recorded; None for none.
        factor: of the channel.
        rest: value where no channel is recorded.
    """

    input: str
    channel: str | None
    factor: float = 1.0
    rest: float = 0.0


@dataclass(frozen=True)
class Observation:
    """Binding of an observed channel.

    Attributes:
        channel: its name.
        address: in the model's sensor data.
        quantity: position, velocity, torque or force.
        dof: index in qvel of the joint that is observed; None for others.
        part: name of the joint, site, body or sensor.
        clock: that its samples are stamped by.
    """

    channel: str
    address: int
    quantity: str
    dof: int | None
    part: str
    clock: str


@dataclass(frozen=True)
class Rig:
    """A nominal model and its bindings.

    Attributes:
        name: for the report.
        spec: as the user gave it, with motors for torques that are recorded of joints, without sensors.
        model: compiled, with the sensors of `observations`.
        controls: one for each actuator, then for x, y, z of each mocap body, then for their quaternions (w
            first), each in the model's order.
        observations: in the order of the columns of recorded data.
        free: names of effects (`name` or `name@part`) that belong to the nominal model: refitted with every
            hypothesis.
        reading: (ny, sensor data) what each observation reads: one sensor, or a sum where joints were split.
        load: addresses of the sensors of each dof's actuator force; -1 for free and ball joints.
        given_integrator: MuJoCo's number of that of the given model, if a better one took its place.
        longest_step: s, of the time steps of simulations; None for the model's own.
    """

    name: str
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    controls: tuple[Control, ...]
    observations: tuple[Observation, ...]
    free: tuple[str, ...]
    reading: np.ndarray
    load: np.ndarray
    given_integrator: int | None = None
    longest_step: float | None = None

    def without(self, channels: Sequence[str]) -> "Rig":
        """The rig without some observations."""
        rows = [i for i, observation in enumerate(self.observations) if observation.channel not in channels]
        observations = tuple(self.observations[i] for i in rows)
        return replace(self, observations=observations, reading=self.reading[rows])

    def sensor_of(self, column: int) -> int:
        """Index of the sensor that a column of the observations reads."""
        return int(np.flatnonzero(self.model.sensor_adr <= self.observations[column].address)[-1])

    @cached_property
    def added_dofs(self) -> tuple[int, ...]:
        """Indices in qvel of joints that an effect with a state of its own has added."""
        names = [self.model.joint(int(j)).name for j in self.model.dof_jntid]
        return tuple(dof for dof, name in enumerate(names) if name.startswith(OWN))

    @cached_property
    def collides(self) -> bool:
        """Whether any two geoms may touch."""
        model = self.model
        touches = model.geom_contype[:, None] & model.geom_conaffinity
        np.fill_diagonal(touches, 0)
        return bool(model.npair or model.nflex or touches.any())

    @cached_property
    def quaternions(self) -> tuple[list[int], ...]:
        """Columns of the observations, w first, of every quaternion that is observed whole."""
        model, parts = self.model, dict[tuple[int, ...], dict[int, int]]()
        for column, observation in enumerate(self.observations):
            sensor = self.sensor_of(column)  # each component has a sensor of its own
            if model.sensor_type[sensor] in _QUATERNIONS:
                of = model.sensor_type[sensor], model.sensor_objtype[sensor], model.sensor_objid[sensor]
                component = observation.address - int(model.sensor_adr[sensor])
                parts.setdefault(tuple(map(int, of)), {})[component] = column
        return tuple([part[i] for i in range(4)] for part in parts.values() if len(part) == 4)


def load_spec(file: Path) -> mujoco.MjSpec:
    """A model from an MJCF or URDF file; meshes that a URDF names are left out.

    Raises:
        InputError: it is missing or does not compile.
    """
    if not file.is_file():
        raise InputError(f"{file}: model is missing; name an MJCF or URDF file")
    try:
        text = file.read_text(errors="replace")
        if is_urdf(text):
            spec = mujoco.MjSpec.from_string(readable_urdf(text))
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
        InputError: a channel names what the model does not have, nothing is observed, or nothing in the model
            can move; one line.
    """
    spec = spec.copy()
    _name_all(spec)
    model = spec.copy().compile()
    if not model.nv:
        raise InputError(
            "model: nothing in it can move; give bodies joints, or a freejoint (the first link of a URDF is "
            "fixed to the world)"
        )
    if model.nhistory or model.npluginstate:
        raise InputError(
            "model: has delays or plugins, whose states cannot be fitted; remove them (a delay is an effect)"
        )
    bound: dict[str, Control] = {}
    for channel_name, channel in channels.items():
        if channel.role == "control":
            target = _input(spec, model, channel_name, channel)
            if target in bound:
                raise InputError(
                    f"channels: {bound[target].channel} and {channel_name} both drive {target}; keep one"
                )
            bound[target] = Control(
                target, channel_name, _input_per_unit(model, channel_name, channel, target)
            )
    plain = spec.copy()
    sensed, added = spec, []
    balanced = {model.body(b).name for b in range(model.nbody) if model.body_simple[b] == 1}
    for body in sensed.bodies:
        if body.name in balanced:
            # A load may move the centre of what turns; MuJoCo else compiles such bodies so that it cannot.
            body.simple = False
    for channel_name, channel in channels.items():
        if channel.role == "observation":
            added.append((channel_name, channel, *add_sensor(sensed, model, channel_name, channel)))
    if not added:
        raise InputError("channels: nothing is observed; record joint positions at least")
    for j in range(model.njnt):
        if model.jnt_type[j] in SCALAR:
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
        joint = channel.joint or _joint_of(compiled, sensor)
        dof = None
        if joint is not None and compiled.joint(joint).type[0] in SCALAR:
            dof = int(compiled.joint(joint).dofadr[0])
        address = int(compiled.sensor(sensor).adr[0]) + component
        part = joint or channel.site or channel.body or channel.sensor or channel.actuator or channel_name
        observations.append(Observation(channel_name, address, channel.quantity, dof, part, channel.clock))
    load = np.full(compiled.nv, -1)
    for j in range(compiled.njnt):
        if compiled.jnt_type[j] in SCALAR:
            sensor = compiled.sensor(f"{OWN}load:{compiled.joint(j).name}")
            load[compiled.jnt_dofadr[j]] = sensor.adr[0]
    inputs = [Control(compiled.actuator(i).name, None) for i in range(compiled.nu)] + _mocap_poses(compiled)
    controls = tuple(bound.get(one.input, one) for one in inputs)
    reading = np.zeros((len(observations), compiled.nsensordata))
    for row, observation in enumerate(observations):
        reading[row, observation.address] = 1
    return Rig(name, plain, compiled, controls, tuple(observations), tuple(free), reading, load)


def _joint_of(model: mujoco.MjModel, sensor: str) -> str | None:
    """The joint whose own position or velocity a sensor of the model reads; None for any other sensor."""
    index, kinds = model.sensor(sensor).id, mujoco.mjtSensor
    kind, target = model.sensor_type[index], int(model.sensor_objid[index])
    if kind in (int(kinds.mjSENS_JOINTPOS), int(kinds.mjSENS_JOINTVEL)):
        return str(model.joint(target).name)
    if kind not in (int(kinds.mjSENS_ACTUATORPOS), int(kinds.mjSENS_ACTUATORVEL)):
        return None
    # Behind a gear an actuator's position is another.
    direct = (
        model.actuator_trntype[target] == int(mujoco.mjtTrn.mjTRN_JOINT)
        and model.actuator_gear[target, 0] == 1
    )
    return str(model.joint(int(model.actuator_trnid[target, 0])).name) if direct else None


def _name_all(spec: mujoco.MjSpec) -> None:
    """Name bodies, joints and actuators without a name, for what is said of them."""
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("actuator", spec.actuators)):
        taken = {element.name for element in elements}
        for i, element in enumerate(elements):
            if not element.name:
                name = f"{kind} {i}"
                element.name = name if name not in taken else f"{name} without a name"


def _mocap_poses(model: mujoco.MjModel) -> list[Control]:
    """Inputs for the poses of mocap bodies, which rest where the model has them."""
    bodies = sorted(
        (b for b in range(model.nbody) if model.body_mocapid[b] >= 0), key=model.body_mocapid.item
    )
    poses = [(PLACE, model.body_pos), (QUATERNION, model.body_quat)]
    return [
        Control(f"{model.body(b).name} {component}", None, rest=float(value))
        for components, pose in poses
        for b in bodies
        for component, value in zip(components, pose[b], strict=True)
    ]


def _input(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, channel: Channel) -> str:
    """The input that a control drives; a motor is added for the torque of a joint."""
    if channel.actuator is not None:
        check_part(model, "actuator", channel.actuator, name)
        return channel.actuator
    if channel.body is not None:
        check_part(model, "body", channel.body, name)
        if model.body(channel.body).mocapid[0] < 0 or channel.quantity != "position":
            raise InputError(
                f"channel {name}: controls body {channel.body} with a {channel.quantity}; only mocap bodies "
                "are controlled, by their positions; name the joint or actuator that is driven"
            )
        return f"{channel.body} {channel.component}"
    if channel.site is not None:
        raise InputError(f"channel {name}: a site is no input; name the joint, actuator or mocap body")
    if channel.joint is None:
        check_part(model, "actuator", name, name)
        return name
    check_part(model, "joint", channel.joint, name)
    if channel.quantity not in ("torque", "force"):
        raise InputError(
            f"channel {name}: controls joint {channel.joint} with a {channel.quantity}; name the actuator "
            "that receives it, or record the torque"
        )
    if model.joint(channel.joint).type[0] in SCALAR:
        check_joint_unit(model, name, channel)
    # Of a free joint along an axis and about it.
    motor = f"{OWN}{channel.joint}" + (
        f":{channel.quantity} {channel.component}" if channel.component else ""
    )
    if spec.actuator(motor) is None:  # a restructured rig has it
        transmission, gear = _transmission(model, name, channel)
        added = spec.add_actuator(name=motor, target=channel.joint, trntype=transmission, gear=gear)
        added.set_to_motor()
        # What was recorded acted: no limit of the model's own motors, whose defaults it would get.
        added.ctrllimited = added.forcelimited = added.actlimited = mujoco.mjtLimited.mjLIMITED_AUTO
        added.ctrlrange = added.forcerange = added.actrange = [0.0, 0.0]
        # Nor of the joint's, which URDF's effort is.
        spec.joint(channel.joint).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    return motor


def _input_per_unit(model: mujoco.MjModel, name: str, channel: Channel, target: str) -> float:
    """Input of an actuator for a unit of what its channel records: a force, before its gear, or the input."""
    if channel.joint is not None or channel.body is not None or channel.quantity not in ("torque", "force"):
        return 1.0
    actuator = model.actuator(target)
    plain = (
        actuator.gaintype[0] == int(mujoco.mjtGain.mjGAIN_FIXED)
        and actuator.biastype[0] == int(mujoco.mjtBias.mjBIAS_NONE)
        and actuator.dyntype[0] == int(mujoco.mjtDyn.mjDYN_NONE)
        and actuator.gainprm[0] != 0
    )
    if not plain:
        raise InputError(
            f"channel {name}: a {channel.quantity} at actuator {target}, which has a law of its "
            "own; record its input as a command, or remove it from the model and name the joint"
        )
    return 1.0 / float(actuator.gainprm[0])


def _transmission(model: mujoco.MjModel, name: str, channel: Channel) -> tuple[mujoco.mjtTrn, list[float]]:
    """Transmission and gear of a motor: of ball and free joints along one axis of the parent or the world."""
    joint = model.joint(channel.joint)
    if joint.type[0] in SCALAR:
        servos = [
            model.actuator(i).name
            for i in range(model.nu)
            if model.actuator_trntype[i] == int(mujoco.mjtTrn.mjTRN_JOINT)
            and model.actuator_trnid[i, 0] == joint.id
            and model.actuator_biastype[i] != int(mujoco.mjtBias.mjBIAS_NONE)
        ]
        if servos:
            raise InputError(
                f"channel {name}: a torque at joint {channel.joint}, which {servos[0]} drives by a law of "
                "its own; remove that actuator from the model, or record its command"
            )
        return mujoco.mjtTrn.mjTRN_JOINT, [1.0, 0, 0, 0, 0, 0]
    if channel.component is None:
        raise InputError(f"channel {name}: joint {channel.joint} has several axes; say which component it is")
    is_free = joint.type[0] == mujoco.mjtJoint.mjJNT_FREE
    axis = "xyz".index(channel.component) + (3 if is_free and channel.quantity == "torque" else 0)
    return mujoco.mjtTrn.mjTRN_JOINTINPARENT, [float(i == axis) for i in range(6)]
