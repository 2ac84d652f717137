"""The recording format, version 1: one folder, SI units, radians, seconds from the hit's start.

| file             | one row is                 | columns                                      |
|------------------|----------------------------|----------------------------------------------|
| recording.json   |                            | see header.Header                            |
| hits.parquet     | one hit                    | see HITS_SCHEMA                              |
| tracks.parquet   | one camera frame of a hit  | see TRACKS_SCHEMA; a missing frame is no row |
| commands.parquet | one joint command of a hit | see joint_schema                             |
| joints.parquet   | one joint reading of a hit | see joint_schema                             |

It describes hits of a sliding object. Only recording.json and hits.parquet are required. The world
frame is right-handed with z up. Version 2, of joints and bodies of any MuJoCo model, stands in `signals`.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import pandas as pd
import pyarrow as pa
from pydantic import Field, model_validator

from slapshot.validation import Model

FORMAT_VERSION = 1

HEADER_FILE = "recording.json"
HITS_FILE = "hits.parquet"
TRACKS_FILE = "tracks.parquet"
COMMANDS_FILE = "commands.parquet"
JOINTS_FILE = "joints.parquet"

Kind = Literal["full", "tracks only", "rest points only"]


# Bounds beyond any rig: values outside are in another unit, or uninitialised memory.
SMALLEST_OBJECT_M, LARGEST_OBJECT_M = 1e-4, 2.0
LONGEST_ID = 64  # characters of an object_id
LIGHTEST_OBJECT_KG, HEAVIEST_OBJECT_KG = 1e-4, 20.0

_EXTENTS = {  # how many numbers size_m has, and what they are
    "box": (3, "three edges"),
    "cylinder": (2, "diameter and height"),
    "sphere": (1, "the diameter"),
}

Extent = Annotated[
    float,
    Field(
        ge=SMALLEST_OBJECT_M,
        le=LARGEST_OBJECT_M,
        description="a full extent in m; if it is in millimetres, divide by 1000",
    ),
]


class ObjectInfo(Model):
    """An object that was hit.

    Attributes:
        shape: Word for the shape.
        size_m: Full extents in m: diameter and height of a cylinder, three edges of a box, or a sphere's
            diameter.
        mass_kg: Measured mass in kg.
        mass_sd_kg: Standard deviation of that measurement in kg; 0 if unknown.
    """

    shape: Literal["box", "cylinder", "sphere"] = Field(description="the one that comes nearest")
    # A file has a list there, which strict reading would refuse.
    size_m: Annotated[tuple[Extent, ...], Field(strict=False)] = Field(
        min_length=1, max_length=3, description="list of full extents in m, such as diameter and height"
    )
    mass_kg: float = Field(
        ge=LIGHTEST_OBJECT_KG,
        le=HEAVIEST_OBJECT_KG,
        description="measured mass in kg; if it is in grams, divide by 1000",
    )
    mass_sd_kg: float = Field(
        ge=0, description="standard deviation of the measured mass in kg, 0 if not known"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        count, meaning = _EXTENTS[self.shape]
        if len(self.size_m) != count:
            raise ValueError(
                f"a {self.shape} has {count} in size_m ({meaning}, in m), not {len(self.size_m)}; correct "
                "shape or size_m"
            )
        if self.mass_sd_kg > self.mass_kg:
            raise ValueError(
                f"mass_sd_kg is {self.mass_sd_kg:g}, more than mass_kg itself ({self.mass_kg:g}); correct "
                "it, or write 0 if unknown"
            )
        return self


# No generated equality: comparing two DataFrames with == gives a table, not an answer.
@dataclass(frozen=True, eq=False)
class Recording:
    """A recording of hits.

    The tables have the columns and units of the schemas below, optional ones included (null where
    nothing was recorded). Rows of one hit are in order of time, but hits may be interleaved: group
    by `hit`. Nullable integers are pandas' Int64, nullable floats NaN, and `latent` holds one
    float array of shape (n_latent,) a hit, or None for all hits.

    Attributes:
        rig: Name of the physical set-up.
        objects: What was hit, by object_id.
        camera_rate_hz: Frames a second of the camera behind `tracks`.
        frame_note: Where the world frame lies on the rig, in words.
        stand_in: True for a simulated stand-in, False for a real robot.
        trajectory_model: Version of the model that decodes `hits.latent`; None without latents.
        note: Free text.
        sealed_truth_sha256: Digest of the file that holds a stand-in's concealed physics.
        hits: One row a hit.
        tracks: The object as the camera saw it, or None.
        commands: Joint position commands, or None.
        joints: Measured joint positions, or None.
    """

    rig: str
    objects: dict[str, ObjectInfo]
    camera_rate_hz: float
    frame_note: str
    stand_in: bool
    trajectory_model: str | None
    note: str
    sealed_truth_sha256: str | None
    hits: pd.DataFrame
    tracks: pd.DataFrame | None
    commands: pd.DataFrame | None
    joints: pd.DataFrame | None

    @property
    def kind(self) -> Kind:
        """What can be identified from the recording, depending on the files it has."""
        if self.tracks is None:
            return "rest points only"
        return "tracks only" if self.commands is None else "full"


def column(name: str, type_: pa.DataType, unit: str, description: str, nullable: bool = False) -> pa.Field:
    """One column with its unit ("1": a number without one; "": not a quantity)."""
    metadata = {b"unit": unit.encode(), b"description": description.encode()}
    return pa.field(name, type_, nullable=nullable, metadata=metadata)


HITS_SCHEMA = pa.schema(
    [
        column("hit", pa.int64(), "", "number of the hit, unique"),
        column("object_id", pa.string(), "", "which object of recording.json was hit"),
        column("order", pa.int64(), "1", "place of the hit in the order of execution"),
        column("recorded_at", pa.timestamp("us", "UTC"), "", "when the hit was executed", True),
        column("command_id", pa.int64(), "", "equal for repeats of one command", True),
        column("start_x", pa.float64(), "m", "object before the hit"),
        column("start_y", pa.float64(), "m", "object before the hit"),
        column("rest_x", pa.float64(), "m", "object at rest; null if not seen", True),
        column("rest_y", pa.float64(), "m", "object at rest; null if not seen", True),
        column("latent", pa.list_(pa.float64()), "1", "latent of the trajectory model", True),
    ]
)

TRACKS_SCHEMA = pa.schema(
    [
        column("hit", pa.int64(), "", "number of the hit"),
        column("t", pa.float64(), "s", "time from the hit's start"),
        column("x", pa.float64(), "m", "object as the camera saw it"),
        column("y", pa.float64(), "m", "object as the camera saw it"),
        column("yaw", pa.float64(), "rad", "turn about z; null where not measured", True),
    ]
)

# A file may leave these out; reading then fills them with nulls.
OPTIONAL_COLUMNS = frozenset({"latent", "yaw"})


def joint_schema(n_joints: int) -> pa.Schema:
    """Schema of commands.parquet and joints.parquet for an arm with `n_joints` joints."""
    return pa.schema(
        [
            column("hit", pa.int64(), "", "number of the hit"),
            column("t", pa.float64(), "s", "time from the hit's start"),
            *(column(f"q{j}", pa.float64(), "rad", f"position of joint {j}") for j in range(n_joints)),
        ]
    )


def joint_columns(table: pd.DataFrame) -> list[str]:
    """Names q0, q1, ... of the joint columns of a table that has been checked, in order."""
    return [f"q{j}" for j in range(len(table.columns) - 2)]
