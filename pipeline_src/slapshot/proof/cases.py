"""Lists of concealed cases: what a rig conceals, how it is recorded, and under which seed.

A list is a CSV file. Only the lab reads what a row conceals: a case is called by its number alone, and rows
stand in random order, so that nothing that a diagnosis is given says which condition it belongs to.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import pandas as pd

from slapshot.errors import InputError

KEEPS = ("full", "no encoders", "tracks only", "rest points only")
_JOIN = "+"


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


def read_cases(file: Path) -> list[Case]:
    """The cases of a list, in its order.

    Raises:
        InputError: there is no such file, or a row is not allowed; one line for a person.
    """
    try:
        # Without pandas's own idea of what is missing, to which "null" belongs.
        table = pd.read_csv(file, dtype=str, keep_default_na=False)
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise InputError(f"{file}: cannot be read as CSV ({' '.join(str(error).split())})") from None
    if tuple(table.columns) != _COLUMNS:
        raise InputError(f"{file}: columns are {', '.join(table.columns)}; write {', '.join(_COLUMNS)}")
    if table["case"].duplicated().any():
        twice = table.loc[table["case"].duplicated(), "case"].iloc[0]
        raise InputError(f"{file}: case {twice} stands twice; give every case a name of its own")
    return [_case(file, i, row) for i, row in enumerate(table.to_dict("records"))]


def _case(file: Path, i: int, row: Mapping[Any, Any]) -> Case:
    where = f"{file}: line {i + 2}"
    if row["keep"] not in KEEPS:
        raise InputError(f"{where}: keep is {row['keep']!r}; use one of: {', '.join(KEEPS)}")
    try:
        pairs = [part.split(":") for part in row["conceals"].split(_JOIN) if part]
        conceals = tuple((kind, float(size)) for kind, size in pairs)
    except ValueError:
        example = f"tilt:0.8{_JOIN}curl:1.2"
        raise InputError(f"{where}: conceals is {row['conceals']!r}; write it like {example}") from None
    try:
        return Case(
            row["case"],
            row["condition"],
            int(row["seed"]),
            conceals,
            int(row["hits"]),
            row["keep"],
            float(row["mistracks"]),
            float(row["noise_time"]),
        )
    except ValueError as error:
        raise InputError(f"{where}: {error}; seed and hits are whole numbers, the last two numbers") from None


def write_cases(cases: Iterable[Case], file: Path) -> None:
    """Write a list."""
    rows = [
        {**asdict(case), "conceals": _JOIN.join(f"{kind}:{size:g}" for kind, size in case.conceals)}
        for case in cases
    ]
    pd.DataFrame(rows, columns=list(_COLUMNS)).to_csv(file, index=False)
