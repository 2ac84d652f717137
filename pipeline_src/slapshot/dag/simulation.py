"""Recipes from the scene to the rollouts, and of the stand-in rigs."""

from collections.abc import Mapping
from typing import Any

from slapshot.dag.recipes import Plan
from slapshot.scenes.domain import domain_module, find_domain, part_module
from slapshot.validation import ProblemAtError


def add_simulation(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Scene, demonstrations, trajectory model, swings and rollouts of a domain."""
    scene, seed = domain["scene"], domain["seed"]
    try:
        find_domain(scene["domain"])
    except ValueError as error:
        raise ProblemAtError(("domains", name, "scene", "domain"), str(error)) from None
    module = domain_module(scene["domain"])
    safety, execution, collector = (
        part_module(scene["domain"], part) for part in ("safety", "execution", "collector")
    )
    plan.add(f"scene/{name}", "scene", scene, modules=[module])
    demonstrations = domain["demonstrations"]
    plan.add(
        f"demonstrations/{name}",
        "demonstrations",
        {"domain": scene["domain"], "seed": seed, **demonstrations},
        {"scene": f"scene/{name}"},
        modules=[module, safety],
    )
    plan.add(
        f"trajectory_model/{name}",
        "trajectory_model",
        {"seed": seed, "duration_s": demonstrations["duration_s"], **domain["trajectory_model"]},
        {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}"},
    )
    plan.add(
        f"swings/{name}",
        "swings",
        {"domain": scene["domain"], "seed": seed, **domain["swings"]},
        {"scene": f"scene/{name}", "trajectory_model": f"trajectory_model/{name}"},
        modules=[safety, execution],
    )
    plan.add(
        f"rollouts/{name}",
        "rollouts",
        {
            "domain": scene["domain"],
            "seed": seed,
            "randomisation": draws(domain["randomisation"]),
            **domain["rollouts"],
        },
        {"scene": f"scene/{name}", "swings": f"swings/{name}"},
        modules=[collector],
    )


def draws(randomisation: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """What is drawn, without labels and units, which only pictures show."""
    keep = ("uniform", "normal", "times")
    return {n: {k: v for k, v in s.items() if k in keep} for n, s in randomisation.items()}


def add_labs(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """A recording of every stand-in rig: `rigs` draws from the ranges of one block of settings."""
    model = f"trajectory_model/{name}"
    for recording, settings in stand_ins(domain).items():
        for rig, label in enumerate(rig_labels(name, recording, settings)):
            plan.add(
                label,
                "lab",
                {
                    "seed": domain["seed"],
                    "rig": rig,
                    "scene": domain["scene"],
                    "trajectory_model_id": plan.recipes[model].id,
                    "lab": settings["lab"],
                },
                {"scene": f"scene/{name}", "trajectory_model": model},
                modules=[domain_module(domain["scene"]["domain"])],
            )


def stand_ins(domain: Mapping[str, Any]) -> dict[str, Any]:
    """Recording -> settings, of those that the lab makes."""
    return {recording: s for recording, s in domain["recordings"].items() if "lab" in s}


def rig_labels(name: str, recording: str, settings: Mapping[str, Any]) -> list[str]:
    """Label of each rig's version."""
    return [f"lab/{name}/{recording}/{rig}" for rig in range(settings["rigs"])]
