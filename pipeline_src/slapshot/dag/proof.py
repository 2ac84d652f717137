"""Recipes of the blind validation: cases with hidden effects, their verdicts, and the score."""

from pathlib import Path
from typing import Literal

from slapshot.blind_validation.cases import Case, read_cases
from slapshot.config.cases import Cases, ScoreSettings, SignaturesSettings, VerdictSettings
from slapshot.config.configuration import Configuration
from slapshot.config.lab import Lab, LabSettings, SharedCommands
from slapshot.config.trajectories import DemonstrationsSettings
from slapshot.dag.diagnosis import SEED, nominal_settings
from slapshot.dag.recipes import Plan
from slapshot.effects import modules_of_results
from slapshot.scenes.domain import domain_module, part_module
from slapshot.validation import ProblemAtError

SMALL: Literal["small"] = "small"
FULL: Literal["full"] = "full"
FRESH = Path("data/proof/fresh.csv")  # cases of `--config proof=fresh`, drawn by the workflow


def add_proof(plan: Plan, config: Configuration) -> None:
    """Add the small validation, which belongs to the figures, and the full one."""
    cases, name = config.cases, config.cases.domain
    domain = config.domains[name]
    if cases.like not in domain.stand_ins:
        return  # without a stand-in rig there is nothing to hide effects in
    pool, kind, lab = cases.pool, domain.scene.domain, config.lab_of_cases
    module = domain_module(kind)
    plan.add(
        f"demonstrations/{name}/pool",
        "demonstrations",
        DemonstrationsSettings.from_parts(pool, domain=kind, seed=cases.seed),
        {"scene": f"scene/{name}"},
        modules=[module, part_module(kind, "safety")],
    )
    plan.add(
        f"signatures/{name}/pool",
        "signatures",
        SignaturesSettings.from_parts(pool, effects=[], rate_hz=lab.joints.rate_hz),
        {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}/pool"},
        modules=[module, *modules_of_results()],
    )
    _add_list(plan, SMALL, _read("small", cases, lab), config, lab)
    if config.proof == "published":
        _add_list(plan, FULL, _read("published", cases, lab), config, lab)
    elif FRESH.is_file():
        _add_list(plan, FULL, read_cases(FRESH), config, lab)


def list_file(cases: Cases, key: Literal["small", "published", "joints"]) -> Path:
    """File of the list named by a key of `cases`.

    Raises:
        ProblemAtError: there is no such file.
    """
    file = Path({"small": cases.small, "published": cases.published, "joints": cases.joints}[key])
    try:
        is_file = file.is_file()
    except OSError:  # the path is too long
        is_file = False
    if not is_file:
        shipped = f"config/cases/{'joints' if key == 'joints' else 'small'}.csv"
        raise ProblemAtError(
            ("cases", key), f"{file}: no such file; name a list of cases (CSV), such as {shipped}"
        )
    return file


def _read(key: Literal["small", "published"], cases: Cases, lab: Lab) -> list[Case]:
    """Cases of the list named by a key of `cases`; the pool must have enough commands for each.

    Raises:
        ProblemAtError: there is no such list, or the pool has too few commands for its hits.
        InputError: the list is invalid.
    """
    file, pool, objects = list_file(cases, key), cases.pool.count, len(lab.objects)
    listed = read_cases(file)
    for case in listed:
        hits, repeats = case.session(lab, pool)
        single = hits - repeats.hits
        enough = repeats.commands + single * objects <= pool and single >= 0
        if hits == 0 or (single < 0 and repeats == lab.repeats):
            raise ProblemAtError(
                ("cases", key),
                f"{case.hits} hits of case {case.case} in {file} are too few for {objects} objects and "
                "lab.repeats; raise the first or lower the last",
            )
        if not enough:
            raise ProblemAtError(
                ("cases", "pool", "count"),
                f"case {case.case} in {file} hits each of {objects} objects {hits} times, for which {pool} "
                "commands are too few, even executed twice; raise the number",
            )
    return listed


def _add_list(
    plan: Plan, which: Literal["small", "full"], cases: list[Case], config: Configuration, lab: Lab
) -> None:
    name, pool = config.cases.domain, config.cases.pool
    domain = config.domains[name]
    module = domain_module(domain.scene.domain)
    shared = {"scene": f"scene/{name}", "signatures": f"signatures/{name}/pool"}
    rig = nominal_settings(domain)
    inputs = dict(shared)
    for case in cases:
        label, found = f"case/{which}/{case.case}", f"verdict/{which}/{case.case}"
        plan.add(
            label,
            "case",
            LabSettings(
                seed=case.seed,
                rig=0,
                scene=domain.scene,
                pool=SharedCommands.from_parts(pool),
                lab=case.settings(lab, pool.count),
            ),
            {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}/pool"},
            modules=[module],
            on_demand=which == FULL,
        )
        plan.add(
            found,
            "verdict",
            VerdictSettings.from_parts(rig, seed=SEED),
            {**shared, "recording": label},
            modules=modules_of_results(),
            on_demand=which == FULL,
        )
        inputs |= {f"case/{case.case}": label, f"verdict/{case.case}": found}
    conditions = {case.case: case.condition for case in cases}
    plan.add(
        f"score/{which}",
        "score",
        ScoreSettings.from_parts(rig, list=which, cases=conditions, diagnosis_seed=SEED, pool=pool, lab=lab),
        inputs,
        modules=modules_of_results(),
        on_demand=which == FULL,
    )
