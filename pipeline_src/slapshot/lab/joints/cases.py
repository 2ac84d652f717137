"""Lists of cases for joints: what a rig conceals, how it is recorded, and under which seed.

A list is a CSV file. Only the lab reads what a row conceals: a case is called by its number alone, and rows
stand in random order, so that nothing that a diagnosis is given says which condition it belongs to.
"""

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from slapshot.config.values import Name
from slapshot.errors import InputError, reading
from slapshot.lab.joints.order import Colour, Condition, Order
from slapshot.validation import Model, short, validated

_JOIN = "+"
_LONGEST = 10_000_000  # bytes of a list, far beyond any use
_COLUMNS = (
    "case", "condition", "rig", "seed", "conceals", "noise", "cluttered", "quantised", "episodes", "seconds"
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A row of a list.

    Attributes:
        case: its name, which says nothing.
        condition: what it is to show, in words.
        order: what it is.
    """

    case: str
    condition: str
    order: Order


class _Concealed(Model):
    kind: str
    size: Annotated[float, Field(gt=0, le=1_000)]


class _Row(Model):
    """What a row may say."""

    case: Name
    condition: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ,.%_-]{0,63}$")]
    rig: str
    seed: Annotated[int, Field(ge=0)]
    conceals: list[_Concealed] = Field(description=f"such as spring:0.8{_JOIN}payload:1.2, or nothing")
    noise: Colour
    cluttered: bool
    quantised: Annotated[float, Field(gt=0, le=0.1)] | None
    episodes: Annotated[int, Field(ge=1, le=1_000)]
    seconds: Annotated[float, Field(ge=0.5, le=60)]

    def order(self) -> Order:
        return Order(
            rig=self.rig,
            seed=self.seed,
            conceals=tuple((one.kind, one.size) for one in self.conceals),
            condition=Condition(self.noise, self.cluttered, self.quantised),
            episodes=self.episodes,
            seconds=self.seconds,
        )


def read_cases(file: Path, *, possible: bool = True) -> list[Case]:
    """The cases of a list, in its order.

    Args:
        file: CSV.
        possible: whether to refuse kinds that a rig cannot conceal, for which its model is built. A plan does
            without, since it must not need MuJoCo; who makes a case is told then.

    Raises:
        InputError: there is no such file, or a row is not allowed; one line for a person.
    """
    with reading(file, "name a list of cases (CSV), such as config/cases/joints-small.csv", _LONGEST):
        data = file.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}:{line}: not a text in UTF-8; save it as one") from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    cases: dict[str, Case] = {}
    try:
        head = next(reader, [])
        if tuple(head) != _COLUMNS:
            raise InputError(f"{file}:1: columns are {short(', '.join(head))}; write {', '.join(_COLUMNS)}")
        for values in filter(None, reader):
            where = f"{file}:{reader.line_num}"
            case = _case(values, where, possible)
            if case.case in cases:
                raise InputError(f"{where}: case {case.case} stands twice; give every case a name of its own")
            cases[case.case] = case
    except csv.Error as error:
        raise InputError(f"{file}:{reader.line_num}: not valid CSV ({error}); mend that line") from None
    if not cases:
        raise InputError(f"{file}: holds no case; add a row")
    return list(cases.values())


def _case(values: list[str], where: str, possible: bool) -> Case:
    if len(values) != len(_COLUMNS):
        raise InputError(f"{where}: has {len(values)} values; write {len(_COLUMNS)}: {', '.join(_COLUMNS)}")
    row: dict[str, Any] = dict(zip(_COLUMNS, values, strict=True))
    row |= {key: _number(row[key]) for key in ("seed", "quantised", "episodes", "seconds")}
    row["cluttered"] = {"yes": True, "no": False}.get(row["cluttered"], row["cluttered"])
    row["quantised"] = None if row["quantised"] == "" else row["quantised"]
    pairs = [part.partition(":") for part in row["conceals"].split(_JOIN) if part]
    row["conceals"] = [{"kind": kind, "size": _number(size)} for kind, _, size in pairs]
    checked = validated(_Row, row, where)
    order = checked.order()
    if possible:
        _check(order, where)
    return Case(checked.case, checked.condition, order)


def _check(order: Order, where: str) -> None:
    from slapshot.lab.joints.case import check_kinds  # these need MuJoCo
    from slapshot.lab.joints.rigs import rig_named

    try:
        check_kinds([kind for kind, _ in order.conceals], rig_named(order.rig))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


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
            order, condition = case.order, case.order.condition
            conceals = _JOIN.join(f"{kind}:{size:g}" for kind, size in order.conceals if size is not None)
            quantised = "" if condition.quantised is None else f"{condition.quantised:g}"
            writer.writerow(
                (case.case, case.condition, order.rig, order.seed, conceals, condition.noise,
                 "yes" if condition.cluttered else "no", quantised, order.episodes, f"{order.seconds:g}")
            )  # fmt: skip
