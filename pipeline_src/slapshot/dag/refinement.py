"""Recipes of range refinement, and of what it is worth on stand-in rigs."""

from collections.abc import Mapping
from typing import Any

from slapshot.adaptation.names import method_settings
from slapshot.dag.adaptation import add_recorded, method_module
from slapshot.dag.recipes import Plan
from slapshot.dag.rigs import add_on_rig, robot_of
from slapshot.dag.simulation import draws
from slapshot.dag.sources import Sources
from slapshot.scenes.domain import part_module


def add_refinement(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Everything of the block `refinement`; nothing without it, or without any recording."""
    settings = domain.get("refinement")
    if settings is None or not domain["recordings"]:
        return
    recording, method = settings["recording"], settings["method"]
    sources = Sources.of(name, domain, [recording])
    label = f"refinement/{name}"
    add_recorded(
        plan,
        label,
        "refinement",
        name,
        domain,
        method,
        sources,
        {
            "domain": name,
            "randomisation": draws(domain["randomisation"]),
            "noise_variance_max": domain["training"]["noise_variance_max"],
            **{key: settings[key] for key in ("samples", "repeats", "nearest")},
        },
        {"rollouts": f"rollouts/{name}"},
    )
    if sources.roles:
        plan.add(f"coverage/{name}", "coverage", {}, {"refinement": label, **sources.roles})
    for rig in settings["retrained"]:
        _add_retrained(plan, name, domain, rig)


def _add_retrained(plan: Plan, name: str, domain: Mapping[str, Any], rig: int) -> None:
    """Rollouts and models made again from one rig's refined ranges, and their errors on new hits of it."""
    settings = domain["refinement"]
    recording, method = settings["recording"], settings["method"]
    which = {"name": name, "rig": rig}
    refinement, train = f"refinement/{name}", f"train/{name}/{method}"
    rollouts, refined = f"refined_rollouts/{name}/{rig}", f"refined_train/{name}/{rig}"
    plan.add(
        rollouts,
        "refined_rollouts",
        {
            **which,
            "domain": domain["scene"]["domain"],
            "seed": domain["seed"],
            "randomisation": draws(domain["randomisation"]),
            **domain["rollouts"],
        },
        {"scene": f"scene/{name}", "swings": f"swings/{name}", "refinement": refinement},
        modules=[part_module(domain["scene"]["domain"], "collector")],
    )
    configured = domain["methods"][method]
    rate = {"learning_rate": configured["learning_rate"]}
    plan.add(
        refined,
        "refined_train",
        {
            **which,
            "method": method,
            "settings": method_settings(configured),
            "training": {"seed": domain["seed"], **domain["training"], **rate},
        },
        {"rollouts": rollouts, "refinement": refinement, "train": train},
        modules=[method_module(method)],
    )
    add_on_rig(
        plan,
        f"refined_errors/{name}/{rig}",
        robot_of(plan, name, domain, recording, rig),
        {key: settings[key] for key in ("samples", "repeats", "queries")},
        {"train": train, "refined": refined},
        [method_module(method)],
    )
