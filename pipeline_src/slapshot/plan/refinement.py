"""Recipes of range refinement, and of what it is worth on stand-in rigs."""

from collections.abc import Mapping
from typing import Any

from slapshot.plan.adaptation import add_recorded
from slapshot.plan.recipes import Plan
from slapshot.plan.simulation import draws
from slapshot.plan.sources import Sources, check_names


def add_refinement(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Everything of the block `refinement`; nothing without it, or without any recording.

    Raises:
        InputError: the block names a recording or a method that the domain does not have.
    """
    settings = domain.get("refinement")
    if settings is None or not domain["recordings"]:
        return
    recording, method = settings["recording"], settings["method"]
    check_names(name, "refinement", domain)
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
