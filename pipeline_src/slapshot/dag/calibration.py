"""Recipes of the calibration: null recordings and recordings of every effect's law, in blocks."""

from collections.abc import Iterator, Mapping
from typing import Any

from slapshot.dag.recipes import Plan
from slapshot.effects.joints import joint_effect_modules
from slapshot.validation import ProblemAtError


def add_calibration(plan: Plan, settings: Mapping[str, Any]) -> None:
    """Blocks of recordings, and the tables made of them."""
    _add_nulls(plan, settings["nulls"])
    _add_coverage(plan, settings["coverage"])


def _add_nulls(plan: Plan, settings: Mapping[str, Any]) -> None:
    labels = []
    for name, rig in sorted(settings["rigs"].items()):
        for first, count in _blocks(settings):
            label = f"null_p_values/{name}/{first}"
            plan.add(
                label,
                "null_p_values",
                {"name": name, **rig, "first": first, "count": count, **_length(settings)},
                modules=joint_effect_modules(),
            )
            labels.append(label)
    _add_table(plan, "null_table", labels)


def _add_coverage(plan: Plan, settings: Mapping[str, Any]) -> None:
    known = [module.rpartition(".")[2] for module in joint_effect_modules()]
    for i, effect in enumerate(settings["effects"]):
        if effect not in known:
            where = ("calibration", "coverage", "effects", i)
            raise ProblemAtError(where, f"no effect {effect!r}; use some of: {', '.join(known)}")
    labels = []
    for effect in settings["effects"] or known:
        for first, count in _blocks(settings):
            label = f"law_intervals/{effect}/{first}"
            own = {"effect": effect, "seed": settings["seed"], "first": first, "count": count}
            plan.add(label, "law_intervals", own | _length(settings), modules=joint_effect_modules())
            labels.append(label)
    _add_table(plan, "coverage_table", labels)


def _blocks(settings: Mapping[str, Any]) -> Iterator[tuple[int, int]]:
    """First recording of each block, and how many it has."""
    recordings, size = settings["recordings"], settings["block"]
    for first in range(0, recordings, size):
        yield first, min(size, recordings - first)


def _length(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {key: settings[key] for key in ("episodes", "seconds")}


def _add_table(plan: Plan, stage: str, labels: list[str]) -> None:
    """A table of blocks, in their order."""
    blocks = {label.partition("/")[2]: label for label in labels}
    plan.add(stage, stage, {"blocks": list(blocks)}, blocks)
