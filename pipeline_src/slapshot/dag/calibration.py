"""Recipes of the calibration: null recordings, and recordings with each effect, in blocks."""

from collections.abc import Iterator

from slapshot.config.calibration import (
    Block,
    Blocks,
    Calibration,
    Coverage,
    HitBlockSettings,
    HitCoverage,
    LawBlockSettings,
    NullBlockSettings,
    Nulls,
    TableSettings,
)
from slapshot.dag.recipes import Plan
from slapshot.effects import effect_modules, modules_of_results
from slapshot.effects.joints import joint_effect_modules
from slapshot.validation import ProblemAtError


def add_calibration(plan: Plan, calibration: Calibration) -> None:
    """Blocks of recordings, and the tables made from them."""
    _add_nulls(plan, calibration.nulls)
    _add_coverage(plan, calibration.coverage)
    _add_hit_coverage(plan, calibration.hit_coverage)


def _add_nulls(plan: Plan, nulls: Nulls) -> None:
    labels = []
    for name, rig in sorted(nulls.rigs.items()):
        for block in _blocks(nulls):
            label = f"null_p_values/{name}/{block.first}"
            settings = NullBlockSettings.from_parts(rig, block, name=name)
            plan.add(label, "null_p_values", settings, modules=joint_effect_modules())
            labels.append(label)
    _add_table(plan, "null_table", labels)


def _add_coverage(plan: Plan, coverage: Coverage) -> None:
    known = [module.rpartition(".")[2] for module in joint_effect_modules()]
    for i, effect in enumerate(coverage.effects):
        if effect not in known:
            where = ("calibration", "coverage", "effects", i)
            raise ProblemAtError(where, f"no effect {effect!r}; use some of: {', '.join(known)}")
    labels = []
    for effect in coverage.effects or known:
        for block in _blocks(coverage):
            label = f"law_intervals/{effect}/{block.first}"
            settings = LawBlockSettings.from_parts(block, effect=effect, seed=coverage.seed)
            plan.add(label, "law_intervals", settings, modules=joint_effect_modules())
            labels.append(label)
    _add_table(plan, "coverage_table", labels)


def _add_hit_coverage(plan: Plan, coverage: HitCoverage) -> None:
    known = [module.rpartition(".")[2] for module in effect_modules()]
    for i, effect in enumerate(coverage.effects):
        if effect not in known:
            where = ("calibration", "hit_coverage", "effects", i)
            raise ProblemAtError(where, f"no effect {effect!r}; use some of: {', '.join(known)}")
    modules, labels = modules_of_results(), []
    for effect in coverage.effects:
        for first in range(0, coverage.recordings, coverage.block):
            label = f"hit_intervals/{effect}/{first}"
            count = min(coverage.block, coverage.recordings - first)
            settings = HitBlockSettings.from_parts(coverage, effect=effect, first=first, count=count)
            plan.add(label, "hit_intervals", settings, modules=modules)
            labels.append(label)
    _add_table(plan, "hit_coverage_table", labels)


def _blocks(blocks: Blocks) -> Iterator[Block]:
    for first in range(0, blocks.recordings, blocks.block):
        yield Block.from_parts(blocks, first=first, count=min(blocks.block, blocks.recordings - first))


def _add_table(plan: Plan, stage: str, labels: list[str]) -> None:
    """Table that joins blocks in their order."""
    blocks = {label.partition("/")[2]: label for label in labels}
    plan.add(stage, stage, TableSettings(blocks=list(blocks)), blocks)
