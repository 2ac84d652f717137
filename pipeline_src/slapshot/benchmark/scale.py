"""The hours that a configuration's long stages would take here, from rates measured at a small size."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from slapshot.benchmark.measures import Measure, seconds
from slapshot.command import Run
from slapshot.plan import Plan
from slapshot.policy.simulator import Simulator
from slapshot.scenes.randomisation import draw_conditions
from slapshot.scenes.scene import Scene
from slapshot.trajectories import demonstrations
from slapshot.trajectories.fit import train
from slapshot.trajectories.swings import SPLITS
from slapshot.trajectories.vae import TrajectoryVae, VaeSizes

_TASKS = 256  # demonstrations that are timed
_STEPS = 100  # training steps of the trajectory model that are timed
_POLICY_HITS = 320  # hits that are timed: an iteration's, before one update


def hours(
    domain: str,
    name: str,
    config: Mapping[str, Any],
    plan: Plan,
    folders: Mapping[str, Path],
    measured: Mapping[str, float],
    cores: int,
) -> list[Measure]:
    """Counts and hours of one configuration (named `name`), stage by stage and together.

    Args:
        domain: its name in the configuration.
        name: of the configuration.
        config: the domain's block.
        plan: of a configuration whose recipe of the demonstrations can be run on `folders`.
        folders: scene and trajectory_model, to time demonstrations and training on.
        measured: the measures so far, by name.
        cores: that the rollouts would use.
    """
    rollouts, training = config["rollouts"], config["training"]
    conditions = sum(rollouts[split] for split in SPLITS) + len(rollouts["named_conditions"])
    hits = conditions * rollouts["hits"]
    rate = measured[f"{domain}_hits_per_second_and_core"] * cores
    swing = 1 / measured[f"{domain}_hits_per_second_and_core_with_own_swing"]
    parts = {
        "demonstrations": config["demonstrations"]["count"] * _demonstration(plan, domain, folders),
        "trajectory_model": config["trajectory_model"]["steps"] * _vae_step(config, folders),
        "swings": sum(config["swings"].values()) * swing,
        "rollouts": hits / rate,
    }
    trainings = {
        f"train_{method}": training["steps"] * measured[f"{domain}_{method}_training_step_{name}"]
        for method in config["methods"]
    }
    if "acting" in config:
        settings = config["acting"]["policy"]
        wanted = settings["models"] * rollouts["train"] * rollouts["hits"]
        parts["policy"] = wanted * _policy_hit(config, folders) / min(cores, settings["models"])
    if "refinement" in config:
        refined = hits / rate + trainings[f"train_{config['refinement']['method']}"]
        parts["refined"] = len(config["refinement"]["retrained"]) * refined
    # Methods are trained side by side, one a core; the longest one bounds them all.
    together = max(*trainings.values(), sum(trainings.values()) / cores)
    return [
        Measure(f"{domain}_{name}_conditions", conditions, "1"),
        Measure(f"{domain}_{name}_hits", hits, "1"),
        *(
            Measure(f"{domain}_{name}_{part}_hours", value / 3600, "h")
            for part, value in (parts | trainings).items()
        ),
        Measure(f"{domain}_{name}_long_stages_hours", (sum(parts.values()) + together) / 3600, "h"),
    ]


def _demonstration(plan: Plan, domain: str, folders: Mapping[str, Path]) -> float:
    """Seconds that a demonstration takes on the one core that the stage uses."""
    config = {**plan.recipes[f"demonstrations/{domain}"].config, "count": _TASKS}
    with tempfile.TemporaryDirectory() as out:
        return seconds(lambda: demonstrations.produce(Run(config, folders, Path(out), 1))) / _TASKS


def _policy_hit(config: Mapping[str, Any], folders: Mapping[str, Path]) -> float:
    """Seconds that a policy's hit takes on one core, without what PPO adds."""
    rng = np.random.default_rng(0)
    randomisation = config["randomisation"]
    conditions = pd.DataFrame(draw_conditions(randomisation, _POLICY_HITS, rng))
    scene, model = Scene.load(folders["scene"]), TrajectoryVae.load(folders["trajectory_model"])
    simulator = Simulator(scene, config["scene"]["domain"], model, conditions, randomisation, 1)
    latents = rng.normal(size=(_POLICY_HITS, model.sizes.latent))
    rows = np.arange(_POLICY_HITS)
    simulator.rests(rows[:2], latents[:2], rng)  # compiles
    return seconds(lambda: simulator.rests(rows, latents, rng)) / _POLICY_HITS


def _vae_step(config: Mapping[str, Any], folders: Mapping[str, Path]) -> float:
    """Seconds of a training step of the trajectory model at the configured sizes."""
    settings = config["trajectory_model"]
    known = TrajectoryVae.load(folders["trajectory_model"]).sizes
    sizes = VaeSizes(
        known.waypoints, known.joints, settings["latent"], tuple(settings["hidden"]), known.duration
    )
    flat = torch.randn(settings["batch"], sizes.waypoints * sizes.joints)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # as the stage does
    try:
        train(flat, sizes, {**settings, "seed": 0, "steps": 2})  # what only the first steps cost
        return seconds(lambda: train(flat, sizes, {**settings, "seed": 0, "steps": _STEPS})) / _STEPS
    finally:
        torch.set_num_threads(threads)
