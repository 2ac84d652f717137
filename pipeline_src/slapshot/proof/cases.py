"""Lists of concealed cases: what a rig conceals, how it is recorded, and under which seed.

A list is a CSV file. Only the lab reads what a row conceals: a case is called by its number alone, and rows
stand in random order, so that nothing that a diagnosis is given says which condition it belongs to.
"""

import csv
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator

from slapshot.config.lab import ConcealedKind, Keep
from slapshot.config.values import Name, Share
from slapshot.errors import InputError, reading
from slapshot.validation import Model, short, validated

_JOIN = "+"
_LONGEST = 10_000_000  # bytes of a list, far beyond any use


@dataclass(frozen=True)
class Case:
    """One concealed case.

    Attributes:
        case: its name, which says nothing.
        condition: of the proof.
        seed: of rig, session and everything that is drawn.
        conceals: kind -> displacement over the hit-to-hit scatter; nothing for a null.
        hits: of all objects together.
        keep: which tables the recording holds.
        mistracks: share of frames that show something else.
        noise_time: s, over which the camera's noise is alike.
    """

    case: str
    condition: str
    seed: int
    conceals: tuple[tuple[str, float], ...] = ()
    hits: int = 200
    keep: str = "full"
    mistracks: float = 0.003
    noise_time: float = 0.0

    def settings(self, base: Mapping[str, Any], pool: int) -> dict[str, Any]:
        """Block `lab` of this case, from the one that all cases share.

        Of more hits than the `pool` of commands has, some commands are executed twice with each object.
        """
        camera = {**base["camera"], "mistrack_share": self.mistracks, "noise_time_s": self.noise_time}
        concealed = [{"kind": kind, "displacement": size} for kind, size in self.conceals]
        objects = len(base["objects"])
        each = self.hits // objects
        # c commands twice and the rest once are c + objects (each - 2 c) commands.
        twice = math.ceil((objects * each - pool) / (2 * objects - 1))
        repeated = {"repeats": {"commands": twice, "times": 2}} if twice > 0 else {}
        return {
            **base,
            **repeated,
            "camera": camera,
            "hits": each,
            "keep": self.keep,
            "concealed": concealed,
            "commands": "pool",
        }


_COLUMNS = tuple(field.name for field in fields(Case))


class _Concealed(Model):
    kind: ConcealedKind
    displacement: Annotated[float, Field(gt=0, le=1_000)]


class _Row(Model):
    """What a row may say."""

    case: Name
    condition: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ,.%_-]{0,63}$")]
    seed: Annotated[int, Field(ge=0)]
    conceals: list[_Concealed] = Field(
        description=f"such as tilt:0.8{_JOIN}curl:1.2, each kind once; or nothing"
    )
    hits: Annotated[int, Field(ge=1, le=100_000)]
    keep: Keep
    mistracks: Share
    noise_time: Annotated[float, Field(ge=0, le=60)]

    @field_validator("conceals")
    @classmethod
    def _each_once(cls, conceals: list[_Concealed]) -> list[_Concealed]:
        kinds = [one.kind for one in conceals]
        if len(set(kinds)) < len(kinds):
            raise ValueError(f"{_JOIN.join(kinds)} names a kind twice; name it once")
        return conceals


def read_cases(file: Path) -> list[Case]:
    """The cases of a list, in its order.

    Raises:
        InputError: there is no such file, or a row is not allowed; one line for a person.
    """
    with reading(file, "name a list of cases (CSV), such as config/cases/small.csv", _LONGEST):
        data = file.read_bytes()
    reader = csv.reader(io.StringIO(_text(data, file), newline=""), strict=True)
    cases: dict[str, Case] = {}
    try:
        head = next(reader, [])
        if tuple(head) != _COLUMNS:
            raise InputError(f"{file}:1: columns are {short(', '.join(head))}; write {', '.join(_COLUMNS)}")
        for values in filter(None, reader):
            where = f"{file}:{reader.line_num}"
            case = _case(values, where)
            if case.case in cases:
                raise InputError(f"{where}: case {case.case} stands twice; give every case a name of its own")
            cases[case.case] = case
    except csv.Error as error:
        raise InputError(f"{file}:{reader.line_num}: not valid CSV ({error}); mend that line") from None
    if not cases:
        raise InputError(f"{file}: holds no case; add a row")
    return list(cases.values())


def _text(data: bytes, file: Path) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}:{line}: not a text in UTF-8; save it as one") from None


def _case(values: list[str], where: str) -> Case:
    if len(values) != len(_COLUMNS):
        raise InputError(f"{where}: has {len(values)} values; write {len(_COLUMNS)}: {', '.join(_COLUMNS)}")
    row: dict[str, Any] = dict(zip(_COLUMNS, values, strict=True))
    row |= {key: _number(row[key]) for key in ("seed", "hits", "mistracks", "noise_time")}
    pairs = [part.partition(":") for part in row["conceals"].split(_JOIN) if part]
    row["conceals"] = [{"kind": kind, "displacement": _number(size)} for kind, _, size in pairs]
    checked = validated(_Row, row, where)
    conceals = tuple((one.kind, one.displacement) for one in checked.conceals)
    return Case(**{key: getattr(checked, key) for key in _COLUMNS} | {"conceals": conceals})


def _number(text: str) -> int | float | str:
    """What a text says as a number, as far as it does."""
    for read in (int, float):
        try:
            return read(text)
        except ValueError:
            continue
    return text


def write_cases(cases: Iterable[Case], file: Path) -> None:
    """Write a list."""
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for case in cases:
            conceals = _JOIN.join(f"{kind}:{size:g}" for kind, size in case.conceals)
            writer.writerow((asdict(case) | {"conceals": conceals}).values())
