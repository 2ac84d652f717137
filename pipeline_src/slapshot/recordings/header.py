"""recording.json: its schema in each version of the format, reading and writing."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import AfterValidator, Field, model_validator

from slapshot.errors import InputError
from slapshot.recordings.channels import Channel, Name, check_channels
from slapshot.recordings.format import FORMAT_VERSION, LONGEST_ID, ObjectInfo, Recording
from slapshot.validation import Model, ProblemAtError, read_json, short, validated

_MAX_LINE, _MAX_NOTE = 200, 20_000  # characters
_MAX_FILE_BYTES = 4_000_000  # bytes
_MAX_OBJECTS, _MAX_CHANNELS = 1000, 500


def one_line(text: str) -> str:
    """The text, if it is a line that one can see.

    Raises:
        ValueError: it is blank, or has a line break or tab.
    """
    if not text.strip() or not text.isprintable():
        raise ValueError(f"{short(text)} is no line of text; write letters, without line break or tab")
    return text


# Names given by users contain blanks, dots and letters of any language.
ObjectId = Annotated[
    str,
    Field(min_length=1, max_length=LONGEST_ID, description="object_id, as in the table of hits"),
    AfterValidator(one_line),
]
Line = Annotated[str, Field(min_length=1, max_length=_MAX_LINE), AfterValidator(one_line)]
Note = Annotated[str, Field(max_length=_MAX_NOTE)]
FreeText = Annotated[Note, Field(description="free text")]


class RigDescription(Model):
    """Description of the rig, in recordings and in mappings."""

    rig: Line = Field(description="name of the set-up")
    objects: dict[ObjectId, ObjectInfo] = Field(
        min_length=1,
        max_length=_MAX_OBJECTS,
        description="object_id -> shape, size_m, mass_kg, mass_sd_kg",
    )
    camera_rate_hz: float = Field(gt=0, le=1e6, description="frames a second")
    frame_note: Note = Field(description="where the world frame lies on the rig")


StandIn = Annotated[bool, Field(description="true for a simulated stand-in, false for a real robot")]
SealedDigest = Annotated[
    str | None,
    Field(default=None, pattern="^[0-9a-f]{64}$", description="SHA-256 of the sealed truth, 64 hex digits"),
]


class _Json(Model):
    """Behaviour shared by all versions of recording.json."""

    @property
    def fields(self) -> dict[str, Any]:
        """Attributes of the recording."""
        return {name: value for name, value in self if name != "format_version"}

    def to_json(self) -> str:
        """Text of the file; optional keys without a value are absent."""
        values = self.model_dump(mode="json", exclude_none=True)
        first = {"format_version": values.pop("format_version")}
        return json.dumps(first | values, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


class Header(RigDescription, _Json):
    """recording.json of version 1: all of a recording of hits but its tables."""

    format_version: Literal[1] = Field(description="1: hits of a sliding object")
    stand_in: StandIn
    note: FreeText = ""
    trajectory_model: Line | None = Field(
        default=None, description="version of the trajectory model, if latents are given"
    )
    sealed_truth_sha256: SealedDigest


class SignalHeader(_Json):
    """recording.json of version 2: all of a recording of signals but its tables."""

    format_version: Literal[2] = Field(description="2: joints and bodies of any model")
    rig: Line = Field(description="name of the set-up")
    stand_in: StandIn
    note: FreeText = ""
    sealed_truth_sha256: SealedDigest
    channels: dict[Name, Channel] = Field(
        min_length=1, max_length=_MAX_CHANNELS, description="name of a column -> what stands in it"
    )

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        try:
            check_channels(self.channels)
        except ProblemAtError as problem:
            raise ProblemAtError(("channels", *problem.loc), str(problem)) from None
        return self


_OF_VERSION: dict[int, type[Header] | type[SignalHeader]] = {1: Header, 2: SignalHeader}
_WHAT = {1: "hits of a sliding object", 2: "joints and bodies"}

H = TypeVar("H", Header, SignalHeader)


def version_in(file: Path) -> int:
    """Which of the versions that are known recording.json is in; 1 where it does not say.

    Raises:
        InputError: The file cannot be read, is not JSON, or is in another version.
    """
    return _version_of(_read(file), file)


def read_header(file: Path, model: type[H]) -> H:
    """Read and check recording.json.

    Args:
        file: To read.
        model: Header of the version that it must be in.

    Raises:
        InputError: The file cannot be read, is not JSON, is of another version, or says what cannot be.
    """
    return check_header(_read(file), file, model)


def check_header(values: Any, file: Path, model: type[H]) -> H:
    """What recording.json says, checked.

    Args:
        values: As JSON has them.
        file: Named in errors.
        model: Header of the version that it must be in.

    Raises:
        InputError: A key is unknown, missing, of the wrong type or out of range, or the version is another.
    """
    # The version is checked first: another version has other keys, which are not errors then.
    version = _version_of(values, file, default=next(v for v, m in _OF_VERSION.items() if m is model))
    if _OF_VERSION[version] is not model:
        wanted = next(v for v, m in _OF_VERSION.items() if m is model)
        raise InputError(
            f"{file}: format_version is {version} ({_WHAT[version]}), and this needs a recording of version "
            f"{wanted} ({_WHAT[wanted]}); name such a recording"
        )
    return validated(model, values, file)


def _read(file: Path) -> Any:
    remedy = f"put the recording's {file.name} there, or name the folder that holds it"
    return read_json(file, remedy, _MAX_FILE_BYTES)


def _version_of(values: Any, file: Path, default: int = 1) -> int:
    """The version that a file says; the default where it says none, which its check then reports."""
    version = values.get("format_version", default) if isinstance(values, dict) else default
    if type(version) is not int or version not in _OF_VERSION:
        raise InputError(
            f"{file}: format_version is {short(version)}, but this slapshot reads version "
            f"{', '.join(map(str, _OF_VERSION))}; write the recording in that one, or use a newer slapshot"
        )
    return version


def header_of(recording: Recording, file: Path) -> Header:
    """The header of a recording.

    Raises:
        InputError: It says what cannot be; `file` is named.
    """
    values = {name: getattr(recording, name) for name in Header.model_fields if name != "format_version"}
    values["objects"] = {name: info.model_dump() for name, info in recording.objects.items()}
    return check_header({"format_version": FORMAT_VERSION, **values}, file, Header)
