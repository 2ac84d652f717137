"""recording.json: what it may say, and to and from it."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from slapshot.errors import InputError
from slapshot.recordings.format import FORMAT_VERSION, LONGEST_ID, ObjectInfo, Recording
from slapshot.validation import Model, read_json, short, validated

_LONGEST_LINE, _LONGEST_NOTE = 200, 20_000  # characters
_LONGEST_FILE = 4_000_000  # bytes
_MOST_OBJECTS = 1000


def one_line(text: str) -> str:
    """The text, if it is a line that one can see.

    Raises:
        ValueError: it is blank, or has a line break or tab.
    """
    if not text.strip() or not text.isprintable():
        raise ValueError(f"{short(text)} is no line of text; write letters, without line break or tab")
    return text


# People's names for things have blanks, dots and letters of any language.
ObjectId = Annotated[
    str,
    Field(min_length=1, max_length=LONGEST_ID, description="object_id, as in the table of hits"),
    AfterValidator(one_line),
]
Line = Annotated[str, Field(min_length=1, max_length=_LONGEST_LINE), AfterValidator(one_line)]
Note = Annotated[str, Field(max_length=_LONGEST_NOTE)]
FreeText = Annotated[Note, Field(description="free text")]


class Described(Model):
    """What a recording says of a rig, whoever made it."""

    rig: Line = Field(description="name of the set-up")
    objects: dict[ObjectId, ObjectInfo] = Field(
        min_length=1,
        max_length=_MOST_OBJECTS,
        description="object_id -> shape, size_m, mass_kg, mass_sd_kg",
    )
    camera_rate_hz: float = Field(gt=0, le=1e6, description="frames a second")
    frame_note: Note = Field(description="where the world frame lies on the rig")


class Header(Described):
    """recording.json: all of a recording but its tables."""

    format_version: Literal[1] = Field(description=f"now {FORMAT_VERSION}")
    stand_in: bool = Field(description="true for a simulated stand-in, false for a real robot")
    note: FreeText = ""
    trajectory_model: Line | None = Field(
        default=None, description="version of the trajectory model, if latents are given"
    )
    sealed_truth_sha256: str | None = Field(
        default=None, pattern="^[0-9a-f]{64}$", description="SHA-256 of the sealed truth, 64 hex digits"
    )

    @property
    def fields(self) -> dict[str, Any]:
        """Attributes of a `Recording`."""
        return {name: value for name, value in self if name != "format_version"}

    def to_json(self) -> str:
        """Text of the file; optional keys without a value are absent."""
        values = self.model_dump(mode="json", exclude_none=True)
        first = {"format_version": values.pop("format_version")}
        return json.dumps(first | values, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


_OF_VERSION: dict[int, type[Header]] = {FORMAT_VERSION: Header}


def read_header(file: Path) -> Header:
    """Read and check recording.json.

    Raises:
        InputError: The file cannot be read, is not JSON, or says what cannot be.
    """
    remedy = f"put the recording's {file.name} there, or name the folder that holds it"
    return check_header(read_json(file, remedy, _LONGEST_FILE), file)


def check_header(values: Any, file: Path) -> Header:
    """What recording.json says, checked.

    Args:
        values: As JSON has them.
        file: Named in errors.

    Raises:
        InputError: A key is unknown, missing, of the wrong type or out of range.
    """
    # The version comes first: another version may have other keys, which are then no mistakes.
    version = values.get("format_version", FORMAT_VERSION) if isinstance(values, dict) else FORMAT_VERSION
    if type(version) is not int or version not in _OF_VERSION:
        raise InputError(
            f"{file}: format_version is {short(version)}, but this slapshot reads version "
            f"{', '.join(map(str, _OF_VERSION))}; write the recording in that one, or use a newer slapshot"
        )
    return validated(_OF_VERSION[version], values, file)


def header_of(recording: Recording, file: Path) -> Header:
    """The header of a recording.

    Raises:
        InputError: It says what cannot be; `file` is named.
    """
    values = {name: getattr(recording, name) for name in Header.model_fields if name != "format_version"}
    values["objects"] = {name: info.model_dump() for name, info in recording.objects.items()}
    return check_header({"format_version": FORMAT_VERSION, **values}, file)
