"""Recipes of the proof: concealed cases, their verdicts, and the score of both."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slapshot.blind_validation.cases import Case, lab_settings, read_cases
from slapshot.dag.diagnosis import SEED, nominal_settings
from slapshot.dag.recipes import Plan
from slapshot.dag.simulation import stand_ins
from slapshot.effects import modules_of_results
from slapshot.scenes.domain import domain_module, part_module
from slapshot.validation import ProblemAtError

SMALL, FULL = "small", "full"
FRESH = Path("data/proof/fresh.csv")  # cases of `--config proof=fresh`, drawn by the workflow


def add_proof(plan: Plan, config: Mapping[str, Any]) -> None:
    """The small proof, which belongs to the figures, and the full one."""
    cases = config["cases"]
    name = cases["domain"]
    domain = config["domains"][name]
    if cases["like"] not in stand_ins(domain):
        return  # without a stand-in rig there is nothing to conceal anything on
    pool = cases["pool"]
    module = domain_module(domain["scene"]["domain"])
    plan.add(
        f"demonstrations/{name}/pool",
        "demonstrations",
        {"domain": domain["scene"]["domain"], "seed": cases["seed"], **pool},
        {"scene": f"scene/{name}"},
        modules=[module, part_module(domain["scene"]["domain"], "safety")],
    )
    lab = lab_settings(config)
    plan.add(
        f"signatures/{name}/pool",
        "signatures",
        {
            "effects": [],
            "count": pool["count"],
            "duration_s": pool["duration_s"],
            "rate_hz": lab["joints"]["rate_hz"],
        },
        {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}/pool"},
        modules=[module, *modules_of_results()],
    )
    _add_list(plan, name, SMALL, _read("small", config, lab), config, lab)
    if config["proof"] == "published":
        _add_list(plan, name, FULL, _read("published", config, lab), config, lab)
    elif FRESH.is_file():
        _add_list(plan, name, FULL, read_cases(FRESH), config, lab)


def list_file(config: Mapping[str, Any], key: str) -> Path:
    """File of the list that stands under a key of `cases`.

    Raises:
        ProblemAtError: there is no such file.
    """
    file = Path(config["cases"][key])
    try:
        is_file = file.is_file()
    except OSError:  # too long
        is_file = False
    if not is_file:
        shipped = f"config/cases/{'joints' if key == 'joints' else 'small'}.csv"
        raise ProblemAtError(
            ("cases", key), f"{file}: no such file; name a list of cases (CSV), such as {shipped}"
        )
    return file


def _read(key: str, config: Mapping[str, Any], lab: Mapping[str, Any]) -> list[Case]:
    """Cases of the list that stands under a key of `cases`, for which the pool has commands enough.

    Raises:
        ProblemAtError: there is no such list, or it asks for hits that there cannot be.
        InputError: what is wrong in the list.
    """
    file, pool = list_file(config, key), config["cases"]["pool"]["count"]
    cases = read_cases(file)
    for case in cases:
        settings = case.settings(lab, pool)
        hits, repeats, objects = settings["hits"], settings["repeats"], len(lab["objects"])
        single = hits - repeats["commands"] * repeats["times"]
        enough = repeats["commands"] + single * objects <= pool and single >= 0
        if hits == 0 or (single < 0 and repeats == lab["repeats"]):
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
    return cases


def _add_list(
    plan: Plan, name: str, which: str, cases: list[Case], config: Mapping[str, Any], lab: Mapping[str, Any]
) -> None:
    domain = config["domains"][name]
    module = domain_module(domain["scene"]["domain"])
    shared = {"scene": f"scene/{name}", "signatures": f"signatures/{name}/pool"}
    rig = nominal_settings(domain)
    inputs = dict(shared)
    for case in cases:
        label, found = f"case/{which}/{case.case}", f"verdict/{which}/{case.case}"
        plan.add(
            label,
            "case",
            {
                "seed": case.seed,
                "rig": 0,
                "scene": domain["scene"],
                "pool": {key: config["cases"]["pool"][key] for key in ("count", "duration_s")},
                "lab": case.settings(lab, config["cases"]["pool"]["count"]),
            },
            {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}/pool"},
            modules=[module],
            on_demand=which == FULL,
        )
        plan.add(
            found,
            "verdict",
            {"seed": SEED, **rig},
            {**shared, "recording": label},
            modules=modules_of_results(),
            on_demand=which == FULL,
        )
        inputs |= {f"case/{case.case}": label, f"verdict/{case.case}": found}
    plan.add(
        f"score/{which}",
        "score",
        {
            "list": which,
            "cases": {case.case: case.condition for case in cases},
            "diagnosis_seed": SEED,
            "pool": config["cases"]["pool"],
            "lab": lab,
            **rig,
        },
        inputs,
        modules=modules_of_results(),
        on_demand=which == FULL,
    )
