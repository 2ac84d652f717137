"""Recipes of the adaptation methods: training, evaluation, uncertainty, latent analysis."""

from collections.abc import Mapping

import numpy as np

from slapshot.adaptation.names import PART, method_file
from slapshot.config.domain import Domain
from slapshot.config.methods import (
    BeliefsSettings,
    CalibrateSettings,
    EnsembleTraining,
    EvaluateRecordingSettings,
    EvaluateSettings,
    PredictionsSettings,
    TrainSettings,
)
from slapshot.config.regression import Regression, RegressionSettings
from slapshot.config.sources import RecordedTasksSettings
from slapshot.dag.recipes import Plan
from slapshot.dag.sources import Sources


def method_module(method: str) -> str:
    """Dotted name of the module that implements a method of the configuration."""
    return f"slapshot.adaptation.{method_file(method)}"


def add_regression(plan: Plan, regression: Regression) -> None:
    """The linear regression walkthrough, which needs no simulator."""
    plan.add("regression", "regression", RegressionSettings.from_parts(regression))


def training_of(domain: Domain, method: str) -> TrainSettings:
    """Training settings of one of the domain's methods."""
    configured = domain.methods[method]
    training = EnsembleTraining.from_parts(
        domain.training, seed=domain.seed, learning_rate=configured.learning_rate
    )
    return TrainSettings(method=method, settings=configured.own, training=training)


def add_method(plan: Plan, name: str, domain: Domain, method: str) -> None:
    """Training of one method, and its evaluation on simulated and recorded hits."""
    train = f"train/{name}/{method}"
    rollouts = {"rollouts": f"rollouts/{name}"}
    add_training(plan, train, "train", training_of(domain, method), domain.training.jobs, rollouts)
    plan.add(
        f"evaluate/{name}/{method}",
        "evaluate",
        EvaluateSettings.from_parts(domain.evaluation, method=method, seed=domain.seed),
        {"train": train, "rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    for recording, described in domain.recordings.items():
        sources = Sources.of(name, domain.recordings, [recording])
        add_recorded(
            plan,
            f"evaluate_recording/{name}/{method}/{recording}",
            "evaluate_recording",
            name,
            EvaluateRecordingSettings.from_parts(
                described, of_model(plan, name, sources), method=method, seed=domain.seed
            ),
            method,
            sources,
        )


def add_training(
    plan: Plan,
    label: str,
    stage: str,
    settings: TrainSettings,
    jobs: int,
    upstream: Mapping[str, str],
    on_demand: bool = False,
) -> None:
    """Training of one method: an ensemble at once, or parts of it in jobs of their own, then joined.

    Args:
        plan: to add to.
        label: of the ensemble.
        stage: that trains, to whose name `_part` is added for parts.
        settings: of the ensemble.
        jobs: over which its models are spread.
        upstream: role -> label of what is trained on.
        on_demand: see `Plan.add`.
    """
    modules, whole = [method_module(settings.method)], settings.training
    if jobs > 1:
        counts = np.diff(np.linspace(0, whole.models, jobs + 1).round().astype(int)).tolist()
        parts = {f"{PART}{k}": label.replace(stage, f"{stage}_part", 1) + f"/{k}" for k in range(jobs)}
        for k, (count, part) in enumerate(zip(counts, parts.values(), strict=True)):
            seed = int(np.random.SeedSequence([whole.seed, k]).generate_state(1)[0])
            own = EnsembleTraining.from_parts(whole, models=count, seed=seed)
            told = settings.model_copy(update={"training": own})
            plan.add(part, f"{stage}_part", told, upstream, modules=modules, on_demand=on_demand)
        upstream = parts
    plan.add(label, stage, settings, upstream, modules=modules, on_demand=on_demand)


def add_uncertainty(plan: Plan, name: str, domain: Domain) -> None:
    """Calibrated intervals and predictions of one method, and hidden states of the selected methods."""
    uncertainty, noise, seed = domain.uncertainty, domain.noise_levels, domain.seed
    method, rollouts = uncertainty.method, {"rollouts": f"rollouts/{name}"}
    plan.add(
        f"calibrate/{name}",
        "calibrate",
        CalibrateSettings.from_parts(uncertainty, noise, seed=seed),
        {"train": f"train/{name}/{method}", **rollouts},
        modules=[method_module(method)],
    )
    sources = Sources.of(name, domain.recordings, list(domain.recordings))
    recorded = of_model(plan, name, sources)
    add_recorded(
        plan,
        f"predictions/{name}",
        "predictions",
        name,
        PredictionsSettings.from_parts(uncertainty, recorded, seed=seed),
        method,
        sources,
        rollouts | {"calibrate": f"calibrate/{name}"},
    )
    for analysed in dict.fromkeys([*domain.latents.methods, method]):
        settings = BeliefsSettings.from_parts(domain.latents, noise, recorded, method=analysed, seed=seed)
        label = f"beliefs/{name}/{analysed}"
        add_recorded(plan, label, "beliefs", name, settings, analysed, sources, rollouts)


def of_model(plan: Plan, name: str, sources: Sources) -> RecordedTasksSettings:
    """Settings of stages that encode recordings with the domain's trajectory model."""
    model = plan.recipes[f"trajectory_model/{name}"].id
    return RecordedTasksSettings(recordings=sources.described, trajectory_model_id=model)


def add_recorded(
    plan: Plan,
    label: str,
    stage: str,
    name: str,
    settings: RecordedTasksSettings,
    method: str,
    sources: Sources,
    upstream: Mapping[str, str] | None = None,
    train: str | None = None,
) -> None:
    """A recipe of a stage that runs a trained method, of the domain or of an arm, on recordings."""
    plan.add(
        label,
        stage,
        settings,
        {
            "train": train or f"train/{name}/{method}",
            "trajectory_model": f"trajectory_model/{name}",
            **(upstream or {}),
            **sources.roles,
        },
        [method_module(method)],
        sources.files,
        on_demand=train is not None,
    )
