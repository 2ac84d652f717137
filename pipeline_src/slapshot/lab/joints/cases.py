"""Lists of cases of joints: hidden effects, measurement conditions and seed of each case.

This module must not need MuJoCo, since planning reads lists of cases.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from slapshot.case_list import JOIN, concealed_of, concealed_text, number, read_list, write_list
from slapshot.config.values import Name
from slapshot.errors import InputError
from slapshot.lab.joints.case_spec import CaseSpec, Colour, MeasurementCondition
from slapshot.validation import Model, validated

_COLUMNS = (
    "case", "condition", "rig", "seed", "conceals", "noise", "cluttered", "quantised", "episodes", "seconds"
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A row of a list.

    Attributes:
        case: its name, which reveals nothing.
        condition: name of the condition.
        spec: its specification.
    """

    case: str
    condition: str
    spec: CaseSpec


class _Concealed(Model):
    kind: str
    size: Annotated[float, Field(gt=0, le=1_000)]


class _Row(Model):
    """What a row may say."""

    case: Name
    condition: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ,.%_-]{0,63}$")]
    rig: str
    seed: Annotated[int, Field(ge=0)]
    conceals: list[_Concealed] = Field(description=f"such as spring:0.8{JOIN}payload:1.2, or nothing")
    noise: Colour
    cluttered: bool
    quantised: Annotated[float, Field(gt=0, le=0.1)] | None
    episodes: Annotated[int, Field(ge=1, le=1_000)]
    seconds: Annotated[float, Field(ge=0.5, le=60)]

    def spec(self) -> CaseSpec:
        return CaseSpec(
            rig=self.rig,
            seed=self.seed,
            conceals=tuple((one.kind, one.size) for one in self.conceals),
            condition=MeasurementCondition(self.noise, self.cluttered, self.quantised),
            episodes=self.episodes,
            seconds=self.seconds,
        )


def read_cases(file: Path, *, possible: bool = True) -> list[Case]:
    """The cases of a list, in its order.

    Args:
        file: CSV.
        possible: whether to check that the effects fit the rig, which compiles its model. Planning skips this
            check, since it must not need MuJoCo; it is then made when the case is recorded.

    Raises:
        InputError: there is no such file, or a row is not allowed; one line for a person.
    """
    return read_list(
        file, _COLUMNS, lambda values, where: _case(values, where, possible), "config/cases/joints-small.csv"
    )


def _case(values: dict[str, str], where: str, possible: bool) -> Case:
    row: dict[str, Any] = dict(values)
    row |= {key: number(values[key]) for key in ("seed", "quantised", "episodes", "seconds")}
    row["cluttered"] = {"yes": True, "no": False}.get(values["cluttered"], values["cluttered"])
    row["quantised"] = None if values["quantised"] == "" else row["quantised"]
    row["conceals"] = concealed_of(values["conceals"], "size")
    checked = validated(_Row, row, where)
    spec = checked.spec()
    if possible:
        _check(spec, where)
    return Case(checked.case, checked.condition, spec)


def _check(spec: CaseSpec, where: str) -> None:
    from slapshot.lab.joints.record_case import check_hidden_effects  # these need MuJoCo
    from slapshot.lab.joints.rigs import rig_named

    try:
        check_hidden_effects([kind for kind, _ in spec.conceals], rig_named(spec.rig))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def write_cases(cases: Iterable[Case], file: Path) -> None:
    """Write a list."""
    write_list(map(_row, cases), _COLUMNS, file)


def _row(case: Case) -> tuple[object, ...]:
    spec, condition = case.spec, case.spec.condition
    conceals = concealed_text((kind, size) for kind, size in spec.conceals if size is not None)
    quantised = "" if condition.quantised is None else f"{condition.quantised:g}"
    return (
        case.case, case.condition, spec.rig, spec.seed, conceals, condition.noise,
        "yes" if condition.cluttered else "no", quantised, spec.episodes, f"{spec.seconds:g}",
    )  # fmt: skip
