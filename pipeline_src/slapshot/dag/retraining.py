"""Recipes that close the circle: rollouts, models and evaluations of three arms about one diagnosis."""

from collections.abc import Mapping
from typing import Any

from slapshot.adaptation.names import method_settings
from slapshot.dag.adaptation import add_recorded, method_module
from slapshot.dag.diagnosis import SEED, nominal_settings
from slapshot.dag.recipes import Plan
from slapshot.dag.simulation import draws
from slapshot.dag.sources import Sources
from slapshot.effects import modules_of_results

NOMINAL, RETRAINED = "nominal", ("refitted", "augmented")


def add_retraining(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Everything of `snakemake circle`; nothing without a block `retraining`, or without any recording."""
    settings = domain.get("retraining")
    if settings is None or not domain["recordings"]:
        return
    recording, method = settings["recording"], settings["method"]
    # Of stand-ins, the rig that is diagnosed.
    described = domain["recordings"][recording]
    first = {**described, "rigs": 1} if "lab" in described else described
    diagnosed = {**domain, "recordings": {recording: first}}
    sources = Sources.of(name, diagnosed, [recording])
    findings = f"findings/{name}"
    plan.add(
        findings,
        "findings",
        {"seed": SEED, "recordings": sources.described, **nominal_settings(domain)},
        {"scene": f"scene/{name}", **sources.roles},
        modules=modules_of_results(),
        files=sources.files,
    )
    rollouts = {NOMINAL: f"rollouts/{name}"}
    trained = {NOMINAL: f"train/{name}/{method}"}
    training = {
        "seed": domain["seed"],
        **domain["training"],
        "learning_rate": domain["methods"][method]["learning_rate"],
    }
    for arm in RETRAINED:
        rollouts[arm], trained[arm] = f"arm_rollouts/{name}/{arm}", f"train/{name}/{method}/{arm}"
        plan.add(
            rollouts[arm],
            "arm_rollouts",
            {
                "arm": arm,
                "seed": domain["seed"],
                "margin": settings["margin"],
                "effects": [],
                "randomisation": draws(domain["randomisation"]),
                **domain["rollouts"],
            },
            {
                "scene": f"scene/{name}",
                "swings": f"swings/{name}",
                "trajectory_model": f"trajectory_model/{name}",
                "findings": findings,
            },
            modules=modules_of_results(),
        )
        plan.add(
            trained[arm],
            "train",
            {
                "method": method,
                "settings": method_settings(domain["methods"][method]),
                "training": training,
            },
            {"rollouts": rollouts[arm]},
            modules=[method_module(method)],
            on_demand=True,
        )
    held = f"held_out/{name}"
    plan.add(
        held,
        "held_out",
        {"recordings": sources.described},
        {"findings": findings, **sources.roles},
        files=sources.files,
    )
    of_held = Sources({"held out": {"rigs": 1}}, {"lab/held out/0": held}, {})
    compared: dict[str, str] = {}
    counts = {key: settings[key] for key in ("samples", "repeats")}
    for arm, train in trained.items():
        for role, hits in (("all", sources), ("held_out", of_held)):
            label = compared[f"errors/{role}/{arm}"] = f"evaluate_recording/{name}/{method}/{arm}/{role}"
            add_recorded(plan, label, "evaluate_recording", name, domain, method, hits, counts, train=train)
        label = compared[f"beliefs/{arm}"] = f"beliefs/{name}/{method}/{arm}"
        details = {
            "samples": [settings["samples"]],
            "repeats": settings["repeats"],
            "noise_variances": domain["evaluation"]["noise_variances"],
            "noise_variance_max": domain["training"]["noise_variance_max"],
        }
        upstream = {"rollouts": rollouts[arm]}
        add_recorded(plan, label, "beliefs", name, domain, method, sources, details, upstream, train)
    plan.add(
        f"arms/{name}",
        "arms",
        {
            "domain": name,
            "seed": domain["seed"],
            "samples": settings["samples"],
            "recordings": sources.described,
        },
        {"findings": findings, "rollouts/refitted": rollouts["refitted"], **compared, **sources.roles},
        files=sources.files,
    )
