"""Both catalogues as tables for people: python -m slapshot.effects, python -m slapshot.effects joints."""

import re
from collections.abc import Sequence
from itertools import groupby

from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect, Parameter
from slapshot.effects.joints.catalogue import joint_effects

_HEADER = (
    "effect",
    "phase",
    "follows",
    "parameters (neutral; bounds; plain case)",
    "law errs by",
    "physics",
    "source",
)


def as_markdown() -> str:
    """One row an effect, those of one's own that are registered included."""
    return _table(_HEADER, [_row(effect) for effect in catalogue().values()])


def joints_as_markdown() -> str:
    """One row an effect on joints and bodies."""
    effects = joint_effects().items()
    return _table(
        ("effect", "physics", "source"), [(f"`{name}`", kind.physics, kind.source) for name, kind in effects]
    )


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _row(effect: Effect) -> tuple[str, ...]:
    cells = (
        f"`{effect.name}`",
        effect.phase,
        effect.follows,
        "<br>".join(_parameters(effect.parameters)),
        f"{100 * effect.known_to:.0f} %",
        effect.physics.replace("\n", " "),
        effect.source,
    )
    return tuple(cell.replace("|", "\\|") for cell in cells)


def _parameters(parameters: Sequence[Parameter]) -> list[str]:
    """One text a parameter; parameters that differ in a number at the end of their names share one."""

    def alike(parameter: Parameter) -> tuple[object, ...]:
        p = parameter
        return re.sub(r"_\d+$", "_", p.name), p.unit, p.low, p.high, p.scale, p.meaning, p.neutral

    texts = []
    for _, group in groupby(parameters, alike):
        members = list(group)
        first, last = members[0], members[-1]
        name = f"`{first.name}`" if first is last else f"`{first.name}` to `{last.name}`"
        unit = "" if first.unit == "1" else f" {first.unit}"
        texts.append(
            f"{name}: {first.meaning} ({first.neutral:g}; {first.low:g} to {first.high:g}; "
            f"{first.scale:g}{unit})"
        )
    return texts
