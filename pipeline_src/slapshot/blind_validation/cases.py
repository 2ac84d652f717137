"""Cases of pucks with concealed physics: hidden effects, recording settings and seed."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator

from slapshot.case_list import JOIN, concealed_of, concealed_text, number, read_list, write_list
from slapshot.config.lab import Camera, ConcealedEffect, ConcealedKind, Keep, Lab, Repeats, StandIns
from slapshot.config.values import Name, Share
from slapshot.validation import Model, validated


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        case: its name, which reveals nothing.
        condition: of the proof.
        seed: of rig, session and everything that is drawn.
        conceals: kind -> displacement over the hit-to-hit scatter; nothing for a null.
        hits: of all objects together.
        keep: which tables the recording holds.
        mistracks: share of frames that show something else.
        noise_time: correlation time of the camera's noise in s.
        jitter: standard deviation of the frames' time stamps over the interval between frames.
        outliers: share of frames whose noise is larger.
    """

    case: str
    condition: str
    seed: int
    conceals: tuple[tuple[ConcealedKind, float], ...] = ()
    hits: int = 200
    keep: Keep = "full"
    mistracks: float = 0.003
    noise_time: float = 0.0
    jitter: float = 0.0
    outliers: float = 0.0

    def session(self, base: Lab, pool: int) -> tuple[int, Repeats]:
        """Hits of each object, and which commands are repeated.

        Of more hits than the `pool` of commands has, some commands are executed twice with each object.
        """
        objects = len(base.objects)
        each = self.hits // objects
        # c commands twice and the rest once are c + objects (each - 2 c) commands.
        twice = math.ceil((objects * each - pool) / (2 * objects - 1))
        return each, Repeats(commands=twice, times=2) if twice > 0 else base.repeats

    def settings(self, base: Lab, pool: int) -> StandIns:
        """Block `lab` of this case, from the one that all cases share; see `session`."""
        hits, repeats = self.session(base, pool)
        return StandIns.from_parts(
            base,
            hits=hits,
            repeats=repeats,
            camera=Camera.from_parts(
                base.camera,
                mistrack_share=self.mistracks,
                noise_time_s=self.noise_time,
                stamp_jitter_share=self.jitter,
                outlier_share=self.outliers,
            ),
            keep=self.keep,
            concealed=[ConcealedEffect(kind=kind, displacement=size) for kind, size in self.conceals],
            commands="pool",
        )


_COLUMNS = tuple(field.name for field in fields(Case))
_NUMBERS = ("seed", "hits", "mistracks", "noise_time", "jitter", "outliers")


class _Concealed(Model):
    kind: ConcealedKind
    displacement: Annotated[float, Field(gt=0, le=1_000)]


class _Row(Model):
    """What a row may say."""

    case: Name
    condition: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ,.%_-]{0,63}$")]
    seed: Annotated[int, Field(ge=0)]
    conceals: list[_Concealed] = Field(
        description=f"such as tilt:0.8{JOIN}curl:1.2, each kind once; or nothing"
    )
    hits: Annotated[int, Field(ge=1, le=100_000)]
    keep: Keep
    mistracks: Share
    noise_time: Annotated[float, Field(ge=0, le=60)]
    jitter: Annotated[float, Field(ge=0, le=0.2)]
    outliers: Share

    @field_validator("conceals")
    @classmethod
    def _each_once(cls, conceals: list[_Concealed]) -> list[_Concealed]:
        kinds = [one.kind for one in conceals]
        if len(set(kinds)) < len(kinds):
            raise ValueError(f"{JOIN.join(kinds)} names a kind twice; name it once")
        return conceals


def read_cases(file: Path) -> list[Case]:
    """The cases of a list, in its order.

    Raises:
        InputError: there is no such file, or a row is not allowed; one line for a person.
    """
    return read_list(file, _COLUMNS, _case, "config/cases/small.csv")


def _case(values: dict[str, str], where: str) -> Case:
    row: dict[str, Any] = dict(values)
    row |= {key: number(values[key]) for key in _NUMBERS}
    row["conceals"] = concealed_of(values["conceals"], "displacement")
    checked = validated(_Row, row, where)
    conceals = tuple((one.kind, one.displacement) for one in checked.conceals)
    return Case(**{key: getattr(checked, key) for key in _COLUMNS} | {"conceals": conceals})


def write_cases(cases: Iterable[Case], file: Path) -> None:
    """Write a list."""
    rows = ((asdict(case) | {"conceals": concealed_text(case.conceals)}).values() for case in cases)
    write_list(rows, _COLUMNS, file)
