"""A rig file: the model of a recording and the binding of its channels, in YAML.

model: robot.xml                       # MJCF or URDF, beside this file
channels:                              # where a recording's channels do not name parts of the model
  tau1: {joint: shoulder}              # or actuator, sensor, site, body, with component x, y, z, qw to qz
ignore: [tau_measured1]                # channels that are not to be used
free: [link_mass, armature@elbow]      # what of the model is not known well: refitted with every hypothesis
timestep: 0.002                        # s, in place of the model's own (optional)
effects: [my_package.my_effect]        # modules with effects of one's own (optional)
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from slapshot.diagnosis.model.rig import Rig, bind, load_spec
from slapshot.errors import InputError
from slapshot.own_code import MODULE
from slapshot.recordings.channels import TARGETS, Channel, Component
from slapshot.recordings.signals import SignalRecording
from slapshot.validation import Model, validated
from slapshot.yaml_file import read_document

Part = Annotated[str, Field(min_length=1, max_length=200)]


class Binding(Model):
    """The model element of a channel."""

    joint: Part | None = Field(default=None, description="name of a joint in the model")
    actuator: Part | None = Field(default=None, description="name of an actuator in the model")
    sensor: Part | None = Field(default=None, description="name of a sensor in the model")
    site: Part | None = Field(default=None, description="name of a site in the model")
    body: Part | None = Field(default=None, description="name of a body in the model")
    component: Component | None = Field(
        default=None, description="of sites, bodies, and of ball and free joints"
    )

    @model_validator(mode="after")
    def _one(self) -> "Binding":
        if sum(getattr(self, kind) is not None for kind in TARGETS) != 1:
            raise ValueError(f"name one of {', '.join(TARGETS)}")
        return self


class RigSettings(Model):
    """What a rig file may say."""

    model: Part = Field(description="MJCF or URDF file, beside the rig file")
    name: Part | None = Field(default=None, description="of the rig, for the report")
    channels: dict[str, Binding] = Field(
        default={}, description="channel of the recording -> part of the model, where it names none itself"
    )
    ignore: tuple[Part, ...] = Field(default=(), description="channels that are not to be used")
    free: tuple[Part, ...] = Field(
        default=(),
        description="effects of the nominal model whose values are refitted, as name or name@part",
    )
    timestep: float | None = Field(default=None, gt=0, le=0.1, description="s, in place of the model's own")
    effects: tuple[Annotated[str, Field(pattern=MODULE, max_length=200)], ...] = Field(
        default=(), description="dotted names of modules that define effects of one's own"
    )


@dataclass(frozen=True)
class RigFile:
    """A rig file that was read.

    Attributes:
        file: for messages.
        model: file of the model.
        settings: all else.
        effects: module -> file and key that name it.
    """

    file: Path
    model: Path
    settings: RigSettings
    effects: dict[str, str]


def read_rig_file(file: Path) -> RigFile:
    """Read and check a rig file.

    Raises:
        InputError: it is missing, or something in it is not allowed; one line for a person.
    """
    document = read_document(file)
    settings = validated(RigSettings, document.values, document.where)
    effects = {m: f"{document.where(('effects', i))}: effects.{i}" for i, m in enumerate(settings.effects)}
    return RigFile(file, file.parent / settings.model, settings, effects)


def rig_of_model(model: Path) -> RigFile:
    """The rig file of a bare model, where the recording's channels name its parts."""
    return RigFile(model, model, RigSettings(model=model.name), {})


def bound_rig(rig: RigFile, recording: SignalRecording) -> tuple[Rig, SignalRecording]:
    """The rig of a recording, and the recording with the channels that are used.

    Raises:
        InputError: model and recording do not fit; one line.
    """
    settings, channels = rig.settings, dict(recording.channels)
    for name in (*settings.ignore, *settings.channels):
        if name not in channels:
            raise InputError(
                f"{rig.file}: channel {name!r} is not in the recording, which has: {', '.join(channels)}"
            )
    for name in settings.ignore:
        if name in settings.channels:
            raise InputError(f"{rig.file}: channel {name!r} is bound and ignored; keep one of the two")
        channels.pop(name, None)
    for name, binding in settings.channels.items():
        values = dict.fromkeys((*TARGETS, "component"))
        given = binding.model_dump(exclude_none=True)
        merged = {**channels[name].model_dump(), **values, **given}
        channels[name] = validated(Channel, merged, f"{rig.file}: channels.{name}")
    spec = load_spec(rig.model)
    if settings.timestep is not None:
        spec.option.timestep = settings.timestep
    try:
        bound = bind(spec, channels, settings.name or recording.rig, settings.free)
    except InputError as error:
        raise InputError(f"{rig.file}: {error}") from None
    return bound, SignalRecording(
        rig=recording.rig, stand_in=recording.stand_in, note=recording.note,
        sealed_truth_sha256=recording.sealed_truth_sha256, channels=channels, episodes=recording.episodes,
        signals=recording.signals,
    )  # fmt: skip
