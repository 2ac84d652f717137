"""Recipes of whatever hits a stand-in rig anew."""

from collections.abc import Mapping
from typing import Any

from slapshot.dag.recipes import Plan
from slapshot.dag.simulation import rig_labels
from slapshot.scenes.domain import domain_module, part_module


def robot_of(plan: Plan, name: str, domain: Mapping[str, Any], recording: str, rig: int) -> dict[str, Any]:
    """What `slapshot.goal_reaching.rigs.robot_of` reads: `config` and `upstream` of a recipe."""
    described, model = domain["recordings"][recording], f"trajectory_model/{name}"
    return {
        "config": {
            "domain": domain["scene"]["domain"],
            "seed": domain["seed"],
            "rig": rig,
            "lab": described["lab"],
            "trajectory_model_id": plan.recipes[model].id,
            "recordings": {recording: {"rigs": 1}},
        },
        "upstream": {
            "scene": f"scene/{name}",
            "trajectory_model": model,
            f"lab/{recording}/0": rig_labels(name, recording, described)[rig],
        },
    }


def add_on_rig(
    plan: Plan,
    label: str,
    robot: Mapping[str, Any],
    config: Mapping[str, Any],
    upstream: Mapping[str, str],
    modules: list[str],
) -> None:
    """The recipe with that label (its stage comes first), of the robot of `robot_of`."""
    scene = robot["config"]["domain"]
    plan.add(
        label,
        label.partition("/")[0],
        robot["config"] | config,
        robot["upstream"] | upstream,
        modules=[*modules, domain_module(scene), part_module(scene, "safety")],
    )
