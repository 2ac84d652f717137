"""The whole pipeline as recipes: which versions a configuration asks for, and what each is made from.

This is the one place that knows how stages follow on each other. The workflow turns every recipe into a
job; adding a method, a recording or a domain to the configuration adds recipes here by itself.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slapshot.errors import InputError
from slapshot.scenes.domain import domain_module
from slapshot.store.recipe import Recipe, make_recipe

# Module that each stage runs: `python -m <module>`.
STAGES = {
    "scene": "slapshot.scenes.__main__",
    "demonstrations": "slapshot.trajectories.demonstrations",
    "trajectory_model": "slapshot.trajectories.fit",
    "swings": "slapshot.trajectories.swings",
    "rollouts": "slapshot.rollouts.__main__",
    "lab": "slapshot.lab.__main__",
    "train": "slapshot.adaptation.train",
    "evaluate": "slapshot.adaptation.evaluate",
    "evaluate_recording": "slapshot.adaptation.evaluate_recording",
    "figure": "slapshot.figures.__main__",
}
# Figure id -> its module.
FIGURES = {
    "F6": "slapshot.figures.f6_setup",
    "F7": "slapshot.figures.f7_simulated",
    "F8": "slapshot.figures.f8_recorded",
    "T2": "slapshot.figures.t2_randomisation",
}

_MUJOCO = ("mujoco", "dm-control", "numpy")
_TORCH = ("torch", "numpy", "safetensors")
_TABLES = ("numpy", "pandas", "pyarrow")
LIBRARIES: dict[str, tuple[str, ...]] = {
    "scene": _MUJOCO,
    "demonstrations": (*_MUJOCO, "scipy"),
    "trajectory_model": (*_TORCH, "mujoco", "scipy"),
    "swings": (*_MUJOCO, *_TORCH, "scipy"),
    "rollouts": (*_MUJOCO, "numba", "pyarrow"),
    "lab": (*_MUJOCO, *_TORCH, "scipy", "numba"),
    "train": _TORCH,
    "evaluate": (*_TORCH, *_TABLES),
    "evaluate_recording": (*_TORCH, *_TABLES),
    "figure": ("matplotlib", "mujoco", "scipy", *_TABLES),
}


@dataclass
class Plan:
    """Recipes by label; a label says stage, domain and what else tells instances apart.

    Attributes:
        recipes: label -> recipe, upstream first. Equal recipes under two labels are one version.
    """

    recipes: dict[str, Recipe] = field(default_factory=dict)

    def add(
        self,
        label: str,
        stage: str,
        config: Mapping[str, Any],
        upstream: Mapping[str, str] | None = None,
        modules: Iterable[str] = (),
        files: Mapping[str, Path] | None = None,
    ) -> None:
        """Add one recipe; `upstream` maps a role to the label of an earlier one."""
        self.recipes[label] = make_recipe(
            stage,
            [STAGES[stage], *modules],
            config,
            {role: self.recipes[up] for role, up in (upstream or {}).items()},
            LIBRARIES[stage],
            files,
        )

    def of_stage(self, stage: str) -> dict[str, Recipe]:
        """Label -> recipe of one stage."""
        return {label: r for label, r in self.recipes.items() if r.stage == stage}

    def by_id(self, stage: str, version_id: str) -> Recipe:
        """The recipe with that id.

        Raises:
            InputError: the configuration asks for no such version.
        """
        for recipe in self.of_stage(stage).values():
            if recipe.id == version_id:
                return recipe
        raise InputError(
            f"the configuration asks for no version {stage}/{version_id}; "
            f"see `slapshot versions why {stage}` for what it asks for"
        )

    def ids(self) -> dict[str, set[str]]:
        """Stage -> ids."""
        return {stage: {r.id for r in self.of_stage(stage).values()} for stage in STAGES}


def make_plan(config: Mapping[str, Any]) -> Plan:
    """Work out all recipes of a checked configuration.

    Raises:
        InputError: a module or a recording that the configuration names does not exist.
    """
    plan = Plan()
    for name, domain in config["domains"].items():
        _add_simulation(plan, name, domain)
        for method in domain["methods"]:
            _add_method(plan, name, domain, method)
    _add_figures(plan, config)
    return plan


def _add_simulation(plan: Plan, name: str, domain: Mapping[str, Any]) -> None:
    scene, seed = domain["scene"], domain["seed"]
    module = domain_module(scene["domain"])
    try:
        plan.add(f"scene/{name}", "scene", scene, modules=[module])
    except ModuleNotFoundError:
        raise InputError(
            f"domains.{name}.scene.domain: no module {module}; use the name of a folder of "
            "slapshot.scenes, or the dotted name of a module that can be imported"
        ) from None
    demonstrations = domain["demonstrations"]
    plan.add(
        f"demonstrations/{name}",
        "demonstrations",
        {"domain": scene["domain"], "seed": seed, **demonstrations},
        {"scene": f"scene/{name}"},
        modules=[module],
    )
    plan.add(
        f"trajectory_model/{name}",
        "trajectory_model",
        {"seed": seed, "duration_s": demonstrations["duration_s"], **domain["trajectory_model"]},
        {"scene": f"scene/{name}", "demonstrations": f"demonstrations/{name}"},
    )
    plan.add(
        f"swings/{name}",
        "swings",
        {"seed": seed, **domain["swings"]},
        {"scene": f"scene/{name}", "trajectory_model": f"trajectory_model/{name}"},
    )
    plan.add(
        f"rollouts/{name}",
        "rollouts",
        {"seed": seed, "randomisation": _draws(domain["randomisation"]), **domain["rollouts"]},
        {"scene": f"scene/{name}", "swings": f"swings/{name}"},
    )
    for recording, settings in domain["recordings"].items():
        if "lab" in settings:
            _add_lab(plan, name, domain, recording, settings["lab"])


def _draws(randomisation: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """What is drawn, without labels and units, which only pictures show."""
    keep = ("uniform", "normal", "times")
    return {n: {k: v for k, v in s.items() if k in keep} for n, s in randomisation.items()}


def _add_lab(
    plan: Plan, name: str, domain: Mapping[str, Any], recording: str, settings: Mapping[str, Any]
) -> None:
    model = f"trajectory_model/{name}"
    plan.add(
        f"lab/{name}/{recording}",
        "lab",
        {
            "seed": domain["seed"],
            "scene": domain["scene"],
            "trajectory_model_id": plan.recipes[model].id,
            "lab": settings,
        },
        {"scene": f"scene/{name}", "trajectory_model": model},
        modules=[domain_module(domain["scene"]["domain"])],
    )


def _add_method(plan: Plan, name: str, domain: Mapping[str, Any], method: str) -> None:
    module = f"slapshot.adaptation.{method}"
    train = f"train/{name}/{method}"
    try:
        plan.add(
            train,
            "train",
            {
                "method": method,
                "settings": domain["methods"][method],
                "training": {"seed": domain["seed"], **domain["training"]},
            },
            {"rollouts": f"rollouts/{name}"},
            modules=[module],
        )
    except ModuleNotFoundError:
        raise InputError(
            f"domains.{name}.methods.{method}: no such method; a method is a file of "
            "slapshot/adaptation, for example kalman"
        ) from None
    common = {"method": method, "seed": domain["seed"]}
    plan.add(
        f"evaluate/{name}/{method}",
        "evaluate",
        {**common, **domain["evaluation"]},
        {"train": train, "rollouts": f"rollouts/{name}"},
        modules=[module],
    )
    for recording, settings in domain["recordings"].items():
        model = f"trajectory_model/{name}"
        upstream = {"train": train, "trajectory_model": model}
        details = {
            **common,
            "samples": settings["samples"],
            "repeats": settings["repeats"],
            "trajectory_model_id": plan.recipes[model].id,
        }
        files: dict[str, Path] = {}
        if "lab" in settings:
            upstream["lab"] = f"lab/{name}/{recording}"
        else:
            details["path"] = settings["path"]
            files = _recording_files(settings["path"], f"domains.{name}.recordings.{recording}.path")
        plan.add(
            f"evaluate_recording/{name}/{method}/{recording}",
            "evaluate_recording",
            details,
            upstream,
            [module],
            files,
        )


def _recording_files(path: str, key: str) -> dict[str, Path]:
    folder = Path(path)
    files = {p.name: p for p in sorted(folder.glob("*")) if p.suffix in {".json", ".parquet"}}
    if not files:
        raise InputError(
            f"{key}: {path} holds no recording (recording.json, hits.parquet, ...); "
            "give the path of a recording's folder"
        )
    return files


def _add_figures(plan: Plan, config: Mapping[str, Any]) -> None:
    for name, domain in config["domains"].items():
        for figure in domain["figures"]:
            if figure not in FIGURES:
                raise InputError(
                    f"domains.{name}.figures: no figure {figure!r}; use some of: {', '.join(FIGURES)}"
                )
            if figure == "F8" and not domain["recordings"]:
                raise InputError(
                    f"domains.{name}.figures: F8 shows recordings, but domains.{name}.recordings is empty; "
                    "name a recording or remove F8"
                )
            upstream, details = _figure_inputs(plan, name, domain, figure)
            plan.add(
                f"figure/{name}/{figure}",
                "figure",
                {"module": FIGURES[figure], "domain": name, **details},
                upstream,
                modules=[FIGURES[figure]],
            )


def _figure_inputs(
    plan: Plan, name: str, domain: Mapping[str, Any], figure: str
) -> tuple[dict[str, str], dict[str, Any]]:
    """Upstream labels by role, and the configuration that a figure shows."""
    methods = list(domain["methods"])
    if figure == "F6":
        labs = {r: f"lab/{name}/{r}" for r, s in domain["recordings"].items() if "lab" in s}
        return {"scene": f"scene/{name}", **labs}, {"scene": domain["scene"]}
    if figure == "F7":
        return {m: f"evaluate/{name}/{m}" for m in methods}, {}
    if figure == "F8":
        pairs = [(m, r) for m in methods for r in domain["recordings"]]
        return {f"{m}/{r}": f"evaluate_recording/{name}/{m}/{r}" for m, r in pairs}, {}
    return {}, {"randomisation": domain["randomisation"]}
