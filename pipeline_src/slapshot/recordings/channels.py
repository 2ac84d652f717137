"""Channels of a recording of signals: what each recorded column means, and which combinations are valid."""

from collections import Counter
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from slapshot.recordings.si import check_si
from slapshot.validation import LONGEST_NAME, NAME, Model, ProblemAtError

Role = Literal["control", "observation"]
Quantity = Literal["position", "velocity", "torque", "force", "command"]
Component = Literal["x", "y", "z", "qw", "qx", "qy", "qz"]
Target = Literal["joint", "actuator", "sensor", "site", "body"]

TARGETS: tuple[Target, ...] = ("joint", "actuator", "sensor", "site", "body")
PLACE: tuple[Component, ...] = ("x", "y", "z")
QUATERNION: tuple[Component, ...] = ("qw", "qx", "qy", "qz")
_RESERVED = ("episode", "t")  # columns that every table of signals has

UNITS: dict[Quantity, tuple[str, ...]] = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "torque": ("N m",),
    "force": ("N",),
    "command": ("1", "rad", "m", "rad/s", "m/s", "N m", "N"),
}

# A clock is part of a file's name, a channel the name of a column.
Name = Annotated[str, Field(pattern=NAME)]
# Names in a MuJoCo model have blanks, slashes and dots.
_ModelName = Annotated[str, Field(min_length=1, max_length=4 * LONGEST_NAME)]


class Channel(Model):
    """One recorded quantity.

    Attributes:
        clock: which table it stands in, signals-<clock>.parquet: channels of one clock are sampled together.
        role: a control is an input of the simulation, an observation is what it is compared with.
        quantity: a command is the input of an actuator (its ctrl); the others are physical.
        joint: name in the MuJoCo model of what the channel is of; at most one of these five. With none, a rig
            file defines it.
        actuator: the same.
        sensor: the same.
        site: the same.
        body: the same.
        component: of what has several: places x, y, z in the world frame and a unit quaternion qw to qz as
            positions, x, y, z of velocities (linear in m/s, angular in rad/s), torques and forces.
        unit: SI.
        hold: of a control: "previous" keeps each value until the next sample, "linear" goes straight to it.
        noise: standard deviation of its white noise in `unit`; None if unknown.
    """

    clock: Name = Field(description="name of the table that it stands in, signals-<clock>.parquet")
    role: Role = Field(description="control: given to the simulation; observation: compared with it")
    quantity: Quantity = Field(description="what is recorded")
    joint: _ModelName | None = Field(default=None, description="name of a joint in the MuJoCo model")
    actuator: _ModelName | None = Field(default=None, description="name of an actuator in the MuJoCo model")
    sensor: _ModelName | None = Field(default=None, description="name of a sensor in the MuJoCo model")
    site: _ModelName | None = Field(default=None, description="name of a site in the MuJoCo model")
    body: _ModelName | None = Field(default=None, description="name of a body in the MuJoCo model")
    component: Component | None = Field(
        default=None, description="of sites, bodies, and of ball and free joints"
    )
    unit: Annotated[str, Field(max_length=LONGEST_NAME)] = Field(description="SI unit such as rad or N m")
    hold: Literal["previous", "linear"] = Field(
        default="previous", description="how a control goes on from one sample to the next"
    )
    noise: float | None = Field(
        default=None, gt=0, description="standard deviation in the channel's unit; leave it out if not known"
    )

    @model_serializer(mode="wrap")
    def _told(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = handler(self)
        if self.role == "observation":
            values.pop("hold", None)
        return values

    @property
    def target(self) -> tuple[Target, str] | None:
        """Type and name of the model element; None where a rig file defines it."""
        named = [(kind, name) for kind in TARGETS if (name := getattr(self, kind)) is not None]
        return named[0] if named else None

    @property
    def of(self) -> str:
        """Description of the quantity and model element."""
        component = f" {self.component}" if self.component else ""
        target = self.target
        return f"{self.quantity}{component} of {target[0]} {target[1]}" if target else self.quantity

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        named = [kind for kind in TARGETS if getattr(self, kind) is not None]
        if len(named) > 1:
            raise ValueError(f"names both {named[0]} and {named[1]}; keep the one that was recorded")
        self._check_target(named[0] if named else None)
        self._check_unit()
        if self.hold != "previous" and self.role == "observation":
            raise ProblemAtError(
                ("hold",), f"{self.hold!r} is of controls, and this is an observation; remove it"
            )
        return self

    def _check_target(self, kind: Target | None) -> None:
        if kind == "sensor" and self.role == "control":
            raise ProblemAtError(("role",), "'control' cannot be, a sensor measures; write observation")
        if self.quantity == "command" and kind not in {"actuator", None}:
            raise ProblemAtError(
                ("quantity",),
                f"'command' is of actuators, not of a {kind}; name the actuator, or write another",
            )
        if kind in {"site", "body"} and self.component is None:
            raise ValueError(
                f"key 'component' is missing; say which of x, y, z (or qw to qz) of the {kind} it is"
            )
        if self.component is not None and (kind == "actuator" or self.quantity == "command"):
            raise ProblemAtError(("component",), f"{self.component!r} cannot be of an actuator; remove it")
        if self.component in QUATERNION and self.quantity != "position":
            raise ProblemAtError(
                ("component",), f"{self.component!r} is of positions; a {self.quantity} has x, y and z"
            )

    def _check_unit(self) -> None:
        try:
            self.check_unit(self.unit)
        except ValueError as error:
            raise ProblemAtError(("unit",), str(error)) from None

    def check_unit(self, unit: str) -> None:
        """Refuse a unit that is none of the quantity.

        Raises:
            ValueError: one line that says how to convert.
        """
        if self.quantity != "position" or self.component is None:
            check_si(unit, UNITS[self.quantity], self.quantity)
        elif self.component in QUATERNION:
            check_si(unit, ("1",), "quaternion's component")
        else:
            check_si(unit, ("m",), "place")


def check_channels(channels: Mapping[str, Channel]) -> None:
    """Refuse channels that cannot stand in one recording.

    Raises:
        ProblemAtError: one line, with the place of the channel below `channels`.
    """
    for name in channels:
        if name in _RESERVED:
            raise ProblemAtError(
                (name,), f"{name!r} is a column of every table; give the channel another name"
            )
    if not any(channel.role == "observation" for channel in channels.values()):
        raise ProblemAtError((), "has no observation; add what was measured, with role observation")
    _check_clock_names(channels)
    _check_controls_once(channels)
    _check_quaternions(channels)


def _check_clock_names(channels: Mapping[str, Channel]) -> None:
    """Refuse clocks whose files would be one file where upper and lower case are the same."""
    spelt: dict[str, str] = {}
    for name, channel in channels.items():
        other = spelt.setdefault(channel.clock.lower(), channel.clock)
        if other != channel.clock:
            raise ProblemAtError(
                (name, "clock"),
                f"{channel.clock!r} differs from clock {other!r} only in case; write one of them everywhere",
            )


def _check_controls_once(channels: Mapping[str, Channel]) -> None:
    """Refuse two controls of one thing: simulation could follow only one."""
    given: dict[tuple[object, ...], str] = {}
    for name, channel in channels.items():
        if channel.role == "control" and channel.target is not None:
            key: tuple[object, ...] = (channel.target,)
            if channel.target[0] != "actuator":  # which takes one number, whatever it means
                key += (channel.component, channel.quantity, channel.unit)
            first = given.setdefault(key, name)
            if first != name:
                raise ProblemAtError(
                    (name,),
                    f"controls the same as {first!r} ({channels[first].of}); keep one of them as control",
                )


def _check_quaternions(channels: Mapping[str, Channel]) -> None:
    """Refuse quaternions of which components are missing, stand there twice, or are on different clocks."""
    for names in quaternions(channels):
        parts = {name: str(channels[name].component) for name in names}
        count = Counter(parts.values())
        for name, part in parts.items():
            if count[part] > 1:
                raise ProblemAtError((name,), f"component {part} is duplicated on its clock; remove one")
        missing = [part for part in QUATERNION if part not in count]
        if missing:
            raise ProblemAtError(
                (names[0],),
                f"is part of a quaternion without {', '.join(missing)}; add it, on the same clock",
            )


def quaternions(channels: Mapping[str, Channel]) -> list[list[str]]:
    """Names of the channels of each quaternion, in the order of `channels`."""
    groups: dict[tuple[object, ...], list[str]] = {}
    for name, channel in channels.items():
        if channel.component in QUATERNION:
            groups.setdefault((channel.target, channel.clock, channel.role), []).append(name)
    return list(groups.values())
