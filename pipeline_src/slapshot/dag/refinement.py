"""Recipes of range refinement, and of its evaluation on stand-in rigs."""

from slapshot.config.domain import Domain
from slapshot.config.refinement import (
    RefinedErrorsSettings,
    RefinedRolloutsSettings,
    RefinedTrainSettings,
    Refinement,
    RefinementSettings,
)
from slapshot.dag.adaptation import add_recorded, add_training, method_module, of_model, training_of
from slapshot.dag.recipes import Plan
from slapshot.dag.rigs import add_on_rig, robot_of
from slapshot.dag.sources import Sources
from slapshot.scenes.domain import part_module


def add_refinement(plan: Plan, name: str, domain: Domain) -> None:
    """Add all recipes of the block `refinement`; none without this block or without recordings."""
    refinement = domain.refinement
    if refinement is None or not domain.recordings:
        return
    sources = Sources.of(name, domain.recordings, [refinement.recording])
    label = f"refinement/{name}"
    add_recorded(
        plan,
        label,
        "refinement",
        name,
        RefinementSettings.from_parts(
            refinement,
            of_model(plan, name, sources),
            domain=name,
            seed=domain.seed,
            randomisation=domain.randomisation,
            noise_variance_max=domain.training.noise_variance_max,
        ),
        refinement.method,
        sources,
        {"rollouts": f"rollouts/{name}"},
    )
    if sources.roles:
        plan.add(f"coverage/{name}", "coverage", None, {"refinement": label, **sources.roles})
    for rig in refinement.retrained:
        _add_retrained(plan, name, domain, refinement, rig)


def _add_retrained(plan: Plan, name: str, domain: Domain, settings: Refinement, rig: int) -> None:
    """Rollouts and models from one rig's refined ranges, and their errors on new hits of that rig."""
    method = settings.method
    refinement, train = f"refinement/{name}", f"train/{name}/{method}"
    rollouts, refined = f"refined_rollouts/{name}/{rig}", f"refined_train/{name}/{rig}"
    plan.add(
        rollouts,
        "refined_rollouts",
        RefinedRolloutsSettings.from_parts(
            domain.rollouts,
            name=name,
            rig=rig,
            domain=domain.scene.domain,
            seed=domain.seed,
            randomisation=domain.randomisation,
        ),
        {"scene": f"scene/{name}", "swings": f"swings/{name}", "refinement": refinement},
        modules=[part_module(domain.scene.domain, "collector")],
    )
    add_training(
        plan,
        refined,
        "refined_train",
        RefinedTrainSettings.from_parts(training_of(domain, method), name=name, rig=rig),
        domain.training.jobs,
        {"rollouts": rollouts, "refinement": refinement, "train": train},
    )
    robot = robot_of(plan, name, domain, settings.recording, rig)
    add_on_rig(
        plan,
        f"refined_errors/{name}/{rig}",
        robot,
        RefinedErrorsSettings.from_parts(settings, robot.settings),
        {"train": train, "refined": refined},
        [method_module(method)],
    )
