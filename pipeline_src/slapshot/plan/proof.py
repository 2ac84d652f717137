"""Recipes of the proof: concealed cases, their verdicts, and the score of both."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slapshot.config import merge
from slapshot.effects import modules_of_results
from slapshot.errors import InputError
from slapshot.plan.diagnosis import SEED, what_is_believed
from slapshot.plan.recipes import Plan
from slapshot.plan.simulation import stand_ins
from slapshot.proof.cases import Case, read_cases
from slapshot.scenes.domain import domain_module, part_module

SMALL, FULL = "small", "full"
FRESH = Path("data/proof/fresh.csv")  # cases of `--config proof=fresh`, drawn by the workflow


def add_proof(plan: Plan, config: Mapping[str, Any]) -> None:
    """The small proof, which belongs to the figures, and the full one."""
    cases = config["cases"]
    name = cases["domain"]
    domain = config["domains"].get(name)
    if domain is None:
        known = ", ".join(config["domains"])
        raise InputError(f"cases.domain: no domain {name!r}; use one of: {known}")
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
    lab = merge(domain["recordings"][cases["like"]]["lab"], cases["lab"])
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
    _add_list(plan, name, SMALL, read_cases(Path(cases["small"])), config, lab)
    file = Path(cases["published"]) if config["proof"] == "published" else FRESH
    if file.is_file() or config["proof"] == "published":
        _add_list(plan, name, FULL, read_cases(file), config, lab)


def _add_list(
    plan: Plan, name: str, which: str, cases: list[Case], config: Mapping[str, Any], lab: Mapping[str, Any]
) -> None:
    domain = config["domains"][name]
    module = domain_module(domain["scene"]["domain"])
    shared = {"scene": f"scene/{name}", "signatures": f"signatures/{name}/pool"}
    rig = what_is_believed(domain)
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
