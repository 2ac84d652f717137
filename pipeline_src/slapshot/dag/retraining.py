"""Recipes that close the loop: rollouts, models and evaluations of three arms after one diagnosis."""

from slapshot.config.cases import DiagnosisSettings
from slapshot.config.domain import Domain
from slapshot.config.methods import BeliefsSettings, EvaluateRecordingSettings
from slapshot.config.retraining import ArmRolloutsSettings, ArmsSettings, HeldOutSettings
from slapshot.config.sources import Source
from slapshot.dag.adaptation import add_recorded, add_training, of_model, training_of
from slapshot.dag.diagnosis import SEED, diagnosed, nominal_settings
from slapshot.dag.recipes import Plan
from slapshot.dag.sources import Sources
from slapshot.effects import modules_of_results

NOMINAL, RETRAINED = "nominal", ("refitted", "augmented")


def add_retraining(plan: Plan, name: str, domain: Domain) -> None:
    """Add all recipes of `snakemake circle`; none without the block `retraining` or without recordings."""
    retraining = domain.retraining
    if retraining is None or not domain.recordings:
        return
    method, seed = retraining.method, domain.seed
    sources = diagnosed(name, domain, retraining.recording)
    findings = f"findings/{name}"
    plan.add(
        findings,
        "findings",
        DiagnosisSettings.from_parts(nominal_settings(domain), recordings=sources.described, seed=SEED),
        {"scene": f"scene/{name}", **sources.roles},
        modules=modules_of_results(),
        files=sources.files,
    )
    rollouts = {NOMINAL: f"rollouts/{name}"}
    trained = {NOMINAL: f"train/{name}/{method}"}
    for arm in RETRAINED:
        rollouts[arm], trained[arm] = f"arm_rollouts/{name}/{arm}", f"train/{name}/{method}/{arm}"
        plan.add(
            rollouts[arm],
            "arm_rollouts",
            ArmRolloutsSettings.from_parts(
                domain.rollouts,
                arm=arm,
                seed=seed,
                margin=retraining.margin,
                effects=[],
                randomisation=domain.randomisation,
            ),
            {
                "scene": f"scene/{name}",
                "swings": f"swings/{name}",
                "trajectory_model": f"trajectory_model/{name}",
                "findings": findings,
            },
            modules=modules_of_results(),
        )
        add_training(
            plan,
            trained[arm],
            "train",
            training_of(domain, method),
            domain.training.jobs,
            {"rollouts": rollouts[arm]},
            on_demand=True,
        )
    held = f"held_out/{name}"
    plan.add(
        held,
        "held_out",
        HeldOutSettings(recordings=sources.described),
        {"findings": findings, **sources.roles},
        files=sources.files,
    )
    of_held = Sources({"held out": Source(rigs=1)}, {"lab/held out/0": held}, {})
    compared: dict[str, str] = {}
    for arm, train in trained.items():
        for role, hits in (("all", sources), ("held_out", of_held)):
            label = compared[f"errors/{role}/{arm}"] = f"evaluate_recording/{name}/{method}/{arm}/{role}"
            settings = EvaluateRecordingSettings.from_parts(retraining, of_model(plan, name, hits), seed=seed)
            add_recorded(plan, label, "evaluate_recording", name, settings, method, hits, train=train)
        label = compared[f"beliefs/{arm}"] = f"beliefs/{name}/{method}/{arm}"
        looked_at = BeliefsSettings.from_parts(
            retraining,
            domain.noise_levels,
            of_model(plan, name, sources),
            seed=seed,
            samples=[retraining.samples],
        )
        upstream = {"rollouts": rollouts[arm]}
        add_recorded(plan, label, "beliefs", name, looked_at, method, sources, upstream, train)
    plan.add(
        f"arms/{name}",
        "arms",
        ArmsSettings(domain=name, seed=seed, samples=retraining.samples, recordings=sources.described),
        {"findings": findings, "rollouts/refitted": rollouts["refitted"], **compared, **sources.roles},
        files=sources.files,
    )
