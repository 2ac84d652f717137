"""Recipes of results for people: figures, claims and Rerun recordings."""

from collections.abc import Mapping, Sequence

from slapshot.config.configuration import Configuration
from slapshot.config.domain import Domain
from slapshot.config.methods import KalmanSettings
from slapshot.config.results import (
    ClaimSettings,
    FigureSettings,
    LatentsFigureSettings,
    MethodFigureSettings,
    PolicyFigureSettings,
    RandomisationFigureSettings,
    SetupFigureSettings,
    Sizes,
    ViewerSettings,
)
from slapshot.dag.recipes import Plan
from slapshot.dag.simulation import rig_labels
from slapshot.dag.sources import Sources
from slapshot.dag.stages import CLAIMS, FIGURES
from slapshot.validation import ProblemAtError
from slapshot.yaml_file import Loc


def add_figures(plan: Plan, config: Configuration) -> None:
    """Add the figures of every domain and of the linear regression."""
    for figure in _known(config.regression.figures, ("regression", "figures"), only=["F3"]):
        _add_figure(plan, "regression", figure, {"regression": "regression"}, None)
    for name, domain in config.domains.items():
        known = [figure for figure in FIGURES if figure != "F3"]
        for figure in _known(domain.figures, ("domains", name, "figures"), only=known):
            if figure == "F8":
                _need_recordings(name, domain, "figures", figure)
            _add_figure(plan, name, figure, _figure_inputs(plan, name, domain, figure), domain)


def _add_figure(
    plan: Plan, name: str, figure: str, upstream: Mapping[str, str], domain: Domain | None
) -> None:
    plan.add(
        f"figure/{name}/{figure}",
        "figure",
        _figure_settings(name, figure, domain),
        upstream,
        modules=[FIGURES[figure]],
    )


def _figure_settings(name: str, figure: str, domain: Domain | None) -> FigureSettings:
    """Settings of a figure from the configuration."""
    plain = FigureSettings(module=FIGURES[figure], domain=name)
    if domain is None:
        return plain
    match figure:
        case "A4" if domain.acting is not None:
            return PolicyFigureSettings.from_parts(plain, method=domain.acting.method)
        case "F2":
            kalman = KalmanSettings.from_parts(domain.methods[domain.uncertainty.method])
            sizes = Sizes(state=2, action=domain.trajectory_model.latent, outcome=2)
            return MethodFigureSettings.from_parts(plain, kalman=kalman, sizes=sizes)
        case "F5" | "F9":
            return LatentsFigureSettings.from_parts(plain, methods=domain.latents.methods)
        case "F6":
            return SetupFigureSettings.from_parts(plain, scene=domain.scene)
        case "T1" | "T2":
            return RandomisationFigureSettings.from_parts(
                plain, figure=figure, randomisation=domain.randomisation
            )
    return plain


def _figure_inputs(plan: Plan, name: str, domain: Domain, figure: str) -> dict[str, str]:
    """Role -> label of each version that a figure reads."""
    methods = list(domain.methods)
    match figure:
        case "A1":
            return _rig_labels(plan, name, figure, "acting")
        case "A2":
            return {"exploration": _needed(plan, f"exploration/{name}", figure)}
        case "A3":
            return {"coverage": _needed(plan, f"coverage/{name}", figure, "refinement")}
        case "A4":
            return _compared_labels(plan, name, domain, figure)
        case "A5":
            return _rig_labels(plan, name, figure, "refined_errors", "refinement")
        case "F1":
            return {"predictions": f"predictions/{name}", "scene": f"scene/{name}"}
        case "F2" | "T1" | "T2":
            return {}
        case "F4" | "F7":
            return {m: f"evaluate/{name}/{m}" for m in methods}
        case "F5" | "F9":
            return {m: f"beliefs/{name}/{m}" for m in domain.latents.methods}
        case "F6":
            labs = {recording: rig_labels(name, recording, s)[0] for recording, s in domain.stand_ins.items()}
            return {"scene": f"scene/{name}", **labs}
        case "F8":
            recorded = [(m, r) for m in methods for r in domain.recordings]
            return {f"{m}/{r}": f"evaluate_recording/{name}/{m}/{r}" for m, r in recorded}
        case "M1":
            return {m: f"train/{name}/{m}" for m in methods}
        case "U1":
            return {"calibrate": f"calibrate/{name}", "predictions": f"predictions/{name}"}
        case "U2":
            return {"beliefs": f"beliefs/{name}/{domain.uncertainty.method}"}
    raise AssertionError(figure)


def add_claims(plan: Plan, config: Configuration) -> None:
    """Add a version for the verdict on each claim, and one that summarises all of them."""
    labels = []
    for claim in _known(config.regression.claims, ("regression", "claims"), only=["C1"]):
        labels.append(_add_claim(plan, "regression", claim, {"regression": "regression"}))
    for name, domain in config.domains.items():
        known = [claim for claim in CLAIMS if claim != "C1"]
        for claim in _known(domain.claims, ("domains", name, "claims"), only=known):
            if claim == "C5":
                _need_recordings(name, domain, "claims", claim)
            labels.append(_add_claim(plan, name, claim, _claim_inputs(plan, name, domain, claim)))
    if labels:
        plan.add("claims", "claims", None, {label.removeprefix("claim/"): label for label in labels})


def _add_claim(plan: Plan, name: str, claim: str, upstream: Mapping[str, str]) -> str:
    label = f"claim/{name}/{claim}"
    settings = ClaimSettings(module=CLAIMS[claim], domain=name)
    plan.add(label, "claim", settings, upstream, modules=[CLAIMS[claim]])
    return label


def _claim_inputs(plan: Plan, name: str, domain: Domain, claim: str) -> dict[str, str]:
    methods = list(domain.methods)
    match claim:
        case "S11":
            refined = {label.rpartition("/")[2]: label for label in _on_rigs(plan, name, "refined_errors")}
            return {"coverage": _needed(plan, f"coverage/{name}", claim, "refinement"), **refined}
        case "S12":
            return _rig_labels(plan, name, claim, "acting")
        case "S13":
            return {"exploration": _needed(plan, f"exploration/{name}", claim)}
        case "C2":
            return {m: f"evaluate/{name}/{m}" for m in methods}
        case "C3":
            return {m: f"beliefs/{name}/{m}" for m in domain.latents.methods}
        case "C4":
            return {m: f"evaluate/{name}/{m}" for m in methods}
        case "C5":
            pairs = [(m, r) for m in methods for r in domain.recordings]
            recorded = {f"{m}/{r}": f"evaluate_recording/{name}/{m}/{r}" for m, r in pairs}
            return recorded | {m: f"evaluate/{name}/{m}" for m in methods}
        case "C6":
            return _compared_labels(plan, name, domain, claim)
        case "C7":
            return {"beliefs": f"beliefs/{name}/{domain.uncertainty.method}"}
    raise AssertionError(claim)


def _rig_labels(plan: Plan, name: str, wanted: str, stage: str, block: str = "acting") -> dict[str, str]:
    """Rig -> label of the version of `stage` on that rig."""
    labels = _on_rigs(plan, name, stage) or [f"{stage}/{name}/0"]
    return {label.rpartition("/")[2]: _needed(plan, label, wanted, block) for label in labels}


def _on_rigs(plan: Plan, name: str, stage: str) -> list[str]:
    return [label for label in plan.of_stage(stage) if label.startswith(f"{stage}/{name}/")]


def _compared_labels(plan: Plan, name: str, domain: Domain, wanted: str) -> dict[str, str]:
    """Versions of policies and models on every rig (role stage/rig), and of the model's predictions."""
    rigs = {
        f"{stage}/{rig}": label
        for stage in ("policy_acting", "acting")
        for rig, label in _rig_labels(plan, name, wanted, stage).items()
    }
    assert domain.acting is not None, "rigs were hit, so that there is such a block"
    method, recording = domain.acting.method, domain.acting.recording
    return rigs | {"predicted": f"evaluate_recording/{name}/{method}/{recording}"}


def _needed(plan: Plan, label: str, wanted: str, block: str = "acting") -> str:
    if label not in plan.recipes:
        raise ProblemAtError(
            ("domains", label.split("/")[1], "figures" if wanted in FIGURES else "claims"),
            f"{wanted} needs a block `{block}` and a recording of stand-in rigs; add what is missing or "
            f"remove {wanted}",
        )
    return label


def _known(wanted: Sequence[str], loc: Loc, only: list[str]) -> Sequence[str]:
    """Return the wanted ids, after checking that each is available here."""
    for i, name in enumerate(wanted):
        if name not in only:
            raise ProblemAtError((*loc, i), f"{name!r} cannot be made here; use some of: {', '.join(only)}")
    return wanted


def _need_recordings(name: str, domain: Domain, key: str, wanted: str) -> None:
    if not domain.recordings:
        raise ProblemAtError(
            ("domains", name, key),
            f"{wanted} needs recordings, but domains.{name}.recordings is empty; name a recording or remove "
            f"{wanted}",
        )


def add_viewer(plan: Plan, name: str, domain: Domain) -> None:
    """Add Rerun recordings of simulated and recorded hits."""
    roles = {stage: f"{stage}/{name}" for stage in ("scene", "swings", "rollouts", "predictions")}
    sources = Sources.of(name, domain.recordings, list(domain.recordings))
    plan.add(
        f"viewer/{name}",
        "viewer",
        ViewerSettings.from_parts(domain.viewer, domain=name, recordings=sources.described),
        roles | sources.roles,
        files=sources.files,
    )
