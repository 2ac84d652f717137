"""Recipes of the adaptation methods: training, evaluation, uncertainty, latent analysis."""

from collections.abc import Mapping
from typing import Any

from slapshot.adaptation.names import method_file, method_settings
from slapshot.dag.recipes import Plan
from slapshot.dag.sources import Sources


def method_module(method: str) -> str:
    """Dotted name of the file that a method of the configuration lives in."""
    return f"slapshot.adaptation.{method_file(method)}"


def add_regression(plan: Plan, settings: Mapping[str, Any]) -> None:
    """The linear regression walkthrough, which needs no simulator."""
    config = {key: value for key, value in settings.items() if key not in {"figures", "claims"}}
    plan.add("regression", "regression", config)


def add_method(plan: Plan, name: str, domain: Mapping[str, Any], method: str) -> None:
    """Training and evaluation, simulated and recorded, of one method."""
    configured = domain["methods"][method]
    learning_rate = {"learning_rate": configured["learning_rate"]}
    training = {"seed": domain["seed"], **domain["training"], **learning_rate}
    train = f"train/{name}/{method}"
    plan.add(
        train,
        "train",
        {"method": method, "settings": method_settings(configured), "training": training},
        {"rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    plan.add(
        f"evaluate/{name}/{method}",
        "evaluate",
        {"method": method, "seed": domain["seed"], **domain["evaluation"]},
        {"train": train, "rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    for recording, settings in domain["recordings"].items():
        add_recorded(
            plan,
            f"evaluate_recording/{name}/{method}/{recording}",
            "evaluate_recording",
            name,
            domain,
            method,
            Sources.of(name, domain, [recording]),
            {"samples": settings["samples"], "repeats": settings["repeats"]},
        )


def add_uncertainty(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    """Calibrated intervals and predictions of one method, hidden states of some."""
    uncertainty, latents = domain["uncertainty"], domain["latents"]
    method = uncertainty["method"]
    measured = {key: value for key, value in uncertainty.items() if key != "shown_noise_variance"}
    plan.add(
        f"calibrate/{name}",
        "calibrate",
        {"seed": domain["seed"], **measured, **_noise(domain)},
        {"train": f"train/{name}/{method}", "rollouts": f"rollouts/{name}"},
        modules=[method_module(method)],
    )
    rollouts = {"rollouts": f"rollouts/{name}"}
    recordings = Sources.of(name, domain, list(domain["recordings"]))
    settings = {key: uncertainty[key] for key in ("draws", "samples", "shown_noise_variance")}
    add_recorded(
        plan,
        f"predictions/{name}",
        "predictions",
        name,
        domain,
        method,
        recordings,
        settings,
        rollouts | {"calibrate": f"calibrate/{name}"},
    )
    details = {k: v for k, v in latents.items() if k != "methods"} | _noise(domain)
    for analysed in dict.fromkeys([*latents["methods"], method]):
        label = f"beliefs/{name}/{analysed}"
        add_recorded(plan, label, "beliefs", name, domain, analysed, recordings, details, rollouts)


def _noise(domain: Mapping[str, Any]) -> dict[str, Any]:
    """The levels of noise to evaluate at, and the largest one of training."""
    return {
        "noise_variances": domain["evaluation"]["noise_variances"],
        "noise_variance_max": domain["training"]["noise_variance_max"],
    }


def add_recorded(
    plan: Plan,
    label: str,
    stage: str,
    name: str,
    domain: Mapping[str, Any],
    method: str,
    sources: Sources,
    settings: Mapping[str, Any],
    upstream: Mapping[str, str] | None = None,
    train: str | None = None,
) -> None:
    """A recipe of a stage that puts recordings before a trained method: the domain's, or that of an arm."""
    model = f"trajectory_model/{name}"
    plan.add(
        label,
        stage,
        {
            "method": method,
            "seed": domain["seed"],
            "trajectory_model_id": plan.recipes[model].id,
            "recordings": sources.described,
            **settings,
        },
        {
            "train": train or f"train/{name}/{method}",
            "trajectory_model": model,
            **(upstream or {}),
            **sources.roles,
        },
        [method_module(method)],
        sources.files,
        on_demand=train is not None,
    )
