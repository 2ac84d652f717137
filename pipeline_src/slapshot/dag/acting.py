"""Recipes of goal reaching: new hits on stand-in rigs with adapted models and policies, and exploration."""

from slapshot.config.acting import (
    ActingSettings,
    ExplorationSettings,
    InverseSettings,
    Policy,
    PolicyActingSettings,
    PolicySettings,
    PolicyTraining,
    StartError,
)
from slapshot.config.domain import Domain
from slapshot.dag.adaptation import add_recorded, method_module, of_model
from slapshot.dag.recipes import Plan
from slapshot.dag.rigs import add_on_rig, robot_of
from slapshot.dag.simulation import rig_labels
from slapshot.dag.sources import Sources
from slapshot.scenes.domain import domain_module, part_module


def add_acting(plan: Plan, name: str, domain: Domain) -> None:
    """Add all recipes of the block `acting`; none without this block or without recordings."""
    acting = domain.acting
    if acting is None or not domain.recordings:
        return
    recording, method = acting.recording, acting.method
    methods = [method, *acting.compared]
    plan.add(
        f"inverse/{name}",
        "inverse",
        InverseSettings(seed=domain.seed, inverse=acting.inverse, training=domain.training),
        {"train": f"train/{name}/{method}", "rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    rigs = rig_labels(name, recording, domain.stand_ins[recording])
    policies = _add_policies(plan, name, domain, acting.policy, min(acting.policy.models, len(rigs)))
    for rig in range(len(rigs)):
        robot = robot_of(plan, name, domain, recording, rig)
        add_on_rig(
            plan,
            f"acting/{name}/{rig}",
            robot,
            ActingSettings.from_parts(robot.settings, acting),
            {"inverse": f"inverse/{name}", **{f"train/{m}": f"train/{name}/{m}" for m in methods}},
            [method_module(m) for m in methods],
        )
        number = rig % len(policies)
        add_on_rig(
            plan,
            f"policy_acting/{name}/{rig}",
            robot,
            PolicyActingSettings.from_parts(
                robot.settings, number=number, policy=acting.policy, targets=acting.targets
            ),
            {"policy": policies[number]},
            [],
        )
    sources = Sources.of(name, domain.recordings, [recording])
    add_recorded(
        plan,
        f"exploration/{name}",
        "exploration",
        name,
        ExplorationSettings.from_parts(
            acting.exploration, of_model(plan, name, sources), method=method, seed=domain.seed
        ),
        method,
        sources,
    )


def _add_policies(plan: Plan, name: str, domain: Domain, policy: Policy, count: int) -> list[str]:
    """Add independently trained policies, each with its own hits; return labels. Rigs use them in turn."""
    scene = domain.scene.domain
    labels = []
    for number in range(count):
        labels.append(f"policy/{name}/{number}")
        plan.add(
            labels[-1],
            "policy",
            PolicySettings(
                domain=scene,
                seed=domain.seed,
                number=number,
                randomisation=StartError(start_error=domain.randomisation.start_error),
                policy=PolicyTraining.from_parts(policy),
            ),
            {
                "scene": f"scene/{name}",
                "trajectory_model": f"trajectory_model/{name}",
                "rollouts": f"rollouts/{name}",
            },
            modules=[domain_module(scene), part_module(scene, "collector")],
        )
    return labels
