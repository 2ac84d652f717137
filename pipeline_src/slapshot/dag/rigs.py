"""Recipes of stages that make new hits on a stand-in rig."""

from collections.abc import Mapping
from dataclasses import dataclass

from slapshot.config.acting import RobotSettings
from slapshot.config.domain import Domain
from slapshot.config.sources import Source
from slapshot.dag.recipes import Plan
from slapshot.dag.simulation import rig_labels
from slapshot.scenes.domain import domain_module, part_module


@dataclass(frozen=True)
class Robot:
    """A stand-in rig for new hits: settings and upstream labels of the recipes that use it."""

    settings: RobotSettings
    upstream: Mapping[str, str]


def robot_of(plan: Plan, name: str, domain: Domain, recording: str, rig: int) -> Robot:
    """The robot of one rig of a stand-in recording."""
    described, model = domain.stand_ins[recording], f"trajectory_model/{name}"
    return Robot(
        RobotSettings(
            domain=domain.scene.domain,
            seed=domain.seed,
            rig=rig,
            lab=described.lab,
            trajectory_model_id=plan.recipes[model].id,
            recordings={recording: Source(rigs=1)},
        ),
        {
            "scene": f"scene/{name}",
            "trajectory_model": model,
            f"lab/{recording}/0": rig_labels(name, recording, described)[rig],
        },
    )


def add_on_rig(
    plan: Plan,
    label: str,
    robot: Robot,
    settings: RobotSettings,
    upstream: Mapping[str, str],
    modules: list[str],
) -> None:
    """Add the recipe of a stage that hits the robot; the label begins with the stage's name."""
    scene = settings.domain
    plan.add(
        label,
        label.partition("/")[0],
        settings,
        {**robot.upstream, **upstream},
        modules=[*modules, domain_module(scene), part_module(scene, "safety")],
    )
