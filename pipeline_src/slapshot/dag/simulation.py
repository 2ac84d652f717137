"""Recipes from the scene to the rollouts, and of the stand-in rigs."""

from slapshot.config.domain import Domain
from slapshot.config.lab import LabSettings
from slapshot.config.recordings import StandInRecording
from slapshot.config.rollouts import RolloutsSettings
from slapshot.config.trajectories import DemonstrationsSettings, SwingsSettings, TrajectoryModelSettings
from slapshot.dag.recipes import Plan
from slapshot.scenes.domain import domain_module, find_domain, part_module
from slapshot.validation import ProblemAtError


def add_simulation(plan: Plan, name: str, domain: Domain) -> None:
    """Add scene, demonstrations, trajectory model, swings and rollouts of a domain."""
    kind, seed = domain.scene.domain, domain.seed
    try:
        find_domain(kind)
    except ValueError as error:
        raise ProblemAtError(("domains", name, "scene", "domain"), str(error)) from None
    module = domain_module(kind)
    safety, execution, collector = (part_module(kind, part) for part in ("safety", "execution", "collector"))
    plan.add(f"scene/{name}", "scene", domain.scene, modules=[module])
    plan.add(
        f"demonstrations/{name}",
        "demonstrations",
        DemonstrationsSettings.from_parts(domain.demonstrations, domain=kind, seed=seed),
        {"scene": f"scene/{name}"},
        modules=[module, safety],
    )
    duration = domain.demonstrations.duration_s
    plan.add(
        f"trajectory_model/{name}",
        "trajectory_model",
        TrajectoryModelSettings.from_parts(domain.trajectory_model, seed=seed, duration_s=duration),
        {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}"},
    )
    plan.add(
        f"swings/{name}",
        "swings",
        SwingsSettings.from_parts(domain.swings, domain=kind, seed=seed),
        {"scene": f"scene/{name}", "trajectory_model": f"trajectory_model/{name}"},
        modules=[safety, execution],
    )
    plan.add(
        f"rollouts/{name}",
        "rollouts",
        RolloutsSettings.from_parts(
            domain.rollouts, domain=kind, seed=seed, randomisation=domain.randomisation
        ),
        {"scene": f"scene/{name}", "swings": f"swings/{name}"},
        modules=[collector],
    )


def add_labs(plan: Plan, name: str, domain: Domain) -> None:
    """Add a recording of every stand-in rig: `rigs` draws from the ranges of one block of settings."""
    model = f"trajectory_model/{name}"
    for recording, described in domain.stand_ins.items():
        for rig, label in enumerate(rig_labels(name, recording, described)):
            plan.add(
                label,
                "lab",
                LabSettings(
                    seed=domain.seed,
                    rig=rig,
                    scene=domain.scene,
                    trajectory_model_id=plan.recipes[model].id,
                    lab=described.lab,
                ),
                {"scene": f"scene/{name}", "trajectory_model": model},
                modules=[domain_module(domain.scene.domain)],
            )


def rig_labels(name: str, recording: str, described: StandInRecording) -> list[str]:
    """Label of each rig's version."""
    return [f"lab/{name}/{recording}/{rig}" for rig in range(described.rigs)]
