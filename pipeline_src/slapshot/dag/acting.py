"""Recipes of acting: stand-in rigs hit anew with adapted models and with policies, and exploration."""

from collections.abc import Mapping
from typing import Any

from slapshot.dag.adaptation import add_recorded, method_module
from slapshot.dag.recipes import Plan
from slapshot.dag.rigs import add_on_rig, robot_of
from slapshot.dag.simulation import draws, rig_labels
from slapshot.dag.sources import Sources
from slapshot.scenes.domain import domain_module, part_module


def add_acting(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Everything of the block `acting`; nothing without it, or without any recording."""
    settings = domain.get("acting")
    if settings is None or not domain["recordings"]:
        return
    recording, method = settings["recording"], settings["method"]
    methods = [method, *settings["compared"]]
    plan.add(
        f"inverse/{name}",
        "inverse",
        {"seed": domain["seed"], "inverse": settings["inverse"], "training": domain["training"]},
        {"train": f"train/{name}/{method}", "rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    rigs = rig_labels(name, recording, domain["recordings"][recording])
    policies = _add_policies(plan, name, domain, min(settings["policy"]["models"], len(rigs)))
    for rig in range(len(rigs)):
        robot = robot_of(plan, name, domain, recording, rig)
        keys = ("method", "compared", "samples", "candidates", "draws", "inverse")
        add_on_rig(
            plan,
            f"acting/{name}/{rig}",
            robot,
            {key: settings[key] for key in (*keys, "targets")},
            {"inverse": f"inverse/{name}", **{f"train/{m}": f"train/{name}/{m}" for m in methods}},
            [method_module(m) for m in methods],
        )
        number = rig % len(policies)
        add_on_rig(
            plan,
            f"policy_acting/{name}/{rig}",
            robot,
            {"number": number, "policy": settings["policy"], "targets": settings["targets"]},
            {"policy": policies[number]},
            [],
        )
    add_recorded(
        plan,
        f"exploration/{name}",
        "exploration",
        name,
        domain,
        method,
        Sources.of(name, domain, [recording]),
        settings["exploration"],
    )


def _add_policies(plan: Plan, name: str, domain: Mapping[str, Any], count: int) -> list[str]:
    """Policies from weights and hits of their own, by label; rigs meet them in turn."""
    settings, scene = domain["acting"]["policy"], domain["scene"]["domain"]
    training = {key: settings[key] for key in settings if key not in {"models", "updates_on_rigs"}}
    labels = []
    for number in range(count):
        labels.append(f"policy/{name}/{number}")
        plan.add(
            labels[-1],
            "policy",
            {
                "domain": scene,
                "seed": domain["seed"],
                "number": number,
                "randomisation": {"start_error": draws(domain["randomisation"])["start_error"]},
                "policy": training,
            },
            {
                "scene": f"scene/{name}",
                "trajectory_model": f"trajectory_model/{name}",
                "rollouts": f"rollouts/{name}",
            },
            modules=[domain_module(scene), part_module(scene, "collector")],
        )
    return labels
