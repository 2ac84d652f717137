"""Recipes of acting on an adapted model: an inverse model, stand-in rigs hit anew, exploration."""

from collections.abc import Mapping
from typing import Any

from slapshot.errors import InputError
from slapshot.plan.adaptation import add_recorded, method_module
from slapshot.plan.recipes import Plan
from slapshot.plan.simulation import rig_labels
from slapshot.plan.sources import Sources
from slapshot.scenes.domain import domain_module, part_module


def add_acting(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Everything of the block `acting`; nothing without it, or without any recording.

    Raises:
        InputError: the block names a method that the domain lacks, or a recording that no stand-in rig made.
    """
    settings = domain.get("acting")
    if settings is None or not domain["recordings"]:
        return
    recording, method = settings["recording"], settings["method"]
    if method not in domain["methods"]:
        raise InputError(
            f"domains.{name}.acting.method: {method!r} is not among domains.{name}.methods; "
            f"use one of: {', '.join(domain['methods'])}"
        )
    stand_ins = [r for r, s in domain["recordings"].items() if "lab" in s]
    if recording not in stand_ins:
        raise InputError(
            f"domains.{name}.acting.recording: {recording!r} is no recording of stand-in rigs, which alone "
            f"can be hit anew; use one of: {', '.join(stand_ins) or 'none there is'}"
        )
    train = f"train/{name}/{method}"
    plan.add(
        f"inverse/{name}",
        "inverse",
        {"seed": domain["seed"], "inverse": settings["inverse"], "training": domain["training"]},
        {"train": train, "rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    described = domain["recordings"][recording]
    model = f"trajectory_model/{name}"
    scene = domain["scene"]["domain"]
    for rig, label in enumerate(rig_labels(name, recording, described)):
        plan.add(
            f"acting/{name}/{rig}",
            "acting",
            {
                "domain": scene,
                "seed": domain["seed"],
                "rig": rig,
                "lab": described["lab"],
                "trajectory_model_id": plan.recipes[model].id,
                "recordings": {recording: {"rigs": 1}},
                **{key: settings[key] for key in ("samples", "targets", "candidates", "draws", "inverse")},
            },
            {
                "scene": f"scene/{name}",
                "trajectory_model": model,
                "train": train,
                "inverse": f"inverse/{name}",
                f"lab/{recording}/0": label,
            },
            modules=[method_module(method), domain_module(scene), part_module(scene, "safety")],
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
