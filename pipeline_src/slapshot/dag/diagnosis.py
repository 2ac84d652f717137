"""Recipes of diagnoses of the recordings that the configuration names."""

from collections.abc import Mapping
from typing import Any

from slapshot.dag.recipes import Plan
from slapshot.dag.sources import Sources
from slapshot.effects import modules_of_results
from slapshot.scenes.randomisation import middle_condition

SEED = 0


def nominal_settings(domain: Mapping[str, Any]) -> dict[str, Any]:
    """What a diagnosis is told beside the scene: the friction, and no effects of one's own."""
    condition = middle_condition(domain["randomisation"])
    return {"friction": [condition[f"friction_{axis}"] for axis in ("x", "y", "torsional")], "effects": []}


def add_diagnoses(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """The report of every recording; of stand-in rigs, of the first one."""
    for recording, settings in domain["recordings"].items():
        first = {**settings, "rigs": 1} if "lab" in settings else settings
        sources = Sources.of(name, {"recordings": {recording: first}}, [recording])
        plan.add(
            f"diagnosis/{name}/{recording}",
            "diagnosis",
            {"seed": SEED, "recordings": sources.described, **nominal_settings(domain)},
            {"scene": f"scene/{name}", **sources.roles},
            modules=modules_of_results(),
            files=sources.files,
        )
