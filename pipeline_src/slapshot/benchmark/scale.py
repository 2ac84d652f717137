"""Predicted hours of a configuration's long stages on this machine, from rates measured at a small size."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from slapshot.adaptation.names import PART
from slapshot.benchmark.measures import Measure, seconds
from slapshot.benchmark.schedule import Job, core_seconds, critical_path, makespan
from slapshot.command import Run
from slapshot.config.domain import Domain
from slapshot.config.trajectories import DemonstrationsSettings, TrajectoryModelSettings
from slapshot.dag import STAGES, Plan
from slapshot.policy.simulator import Simulator
from slapshot.scenes.randomisation import draw_conditions
from slapshot.scenes.scene import Scene
from slapshot.trajectories import demonstrations
from slapshot.trajectories.fit import train
from slapshot.trajectories.swings import SPLITS
from slapshot.trajectories.vae import TrajectoryVae, VaeSizes
from slapshot.validation import values_of

LEAST_CORES = 2  # hours are also reported for this number of cores
CLUSTER_CORES = 2, 16, 200  # for which hours of all domains together are reported

_TASKS = 256  # demonstrations that are timed
_STEPS = 100  # training steps of the trajectory model that are timed
_POLICY_HITS = 320  # hits that are timed: those of an iteration before one update


def configured_jobs(
    domain: str,
    name: str,
    config: Domain,
    plans: Mapping[str, Plan],
    folders: Mapping[str, Path],
    measured: Mapping[str, float],
) -> dict[str, Job]:
    """The jobs of the configuration called `name`, of which the domain's long stages take time.

    Args:
        domain: its name in the configuration.
        name: of the configuration.
        config: the domain's block.
        plans: of the configuration, and as `default` of one whose demonstrations can be made from `folders`.
        folders: scene and trajectory_model, for timing demonstrations and training.
        measured: the measures so far, by name.
    """
    rollouts, training = config.rollouts, config.training
    costs = {
        "demonstrations": config.demonstrations.count * _demonstration(plans["default"], domain, folders),
        "trajectory_model": config.trajectory_model.steps * _vae_step(config, folders),
        "swings": sum(config.swings.count(split) for split in SPLITS)
        / measured[f"{domain}_hits_per_second_and_core_with_own_swing"],
        "rollouts": rollouts.conditions * rollouts.hits / measured[f"{domain}_hits_per_second_and_core"],
    }
    for method in config.methods:
        costs[f"train_{method}"] = training.steps * measured[f"{domain}_{method}_training_step_{name}"]
    if config.acting is not None:
        costs["policy"] = rollouts.train * rollouts.hits * _policy_hit(config, folders)
    return long_jobs(
        plans[name], domain, costs, None if config.refinement is None else config.refinement.method
    )


def hours(domain: str, name: str, config: Domain, jobs: Mapping[str, Job], cores: int) -> list[Measure]:
    """Counts and hours of the configuration called `name`, for each stage and in total.

    Args:
        domain: its name in the configuration.
        name: of the configuration.
        config: the domain's block.
        jobs: from `configured_jobs`.
        cores: of this machine.
    """
    conditions = config.rollouts.conditions
    return [
        Measure(f"{domain}_{name}_conditions", conditions, "1"),
        Measure(f"{domain}_{name}_hits", conditions * config.rollouts.hits, "1"),
        *stage_hours(f"{domain}_{name}", jobs, cores),
    ]


def cluster_hours(name: str, domains: Sequence[Mapping[str, Job]]) -> list[Measure]:
    """Hours of the long stages of all domains together, on one machine's cores and on many.

    Args:
        name: of the configuration.
        domains: jobs of the same plan, each with the times of one domain.
    """
    jobs = {
        label: max((jobs[label] for jobs in domains), key=lambda job: job.core_seconds)
        for label in domains[0]
    }
    rows = [Measure(f"{name}_core_hours", core_seconds(jobs) / 3600, "h")]
    for cores in CLUSTER_CORES:
        path, span = critical_path(jobs, cores), makespan(jobs, cores)
        rows += [
            Measure(f"{name}_critical_path_hours_{cores}_cores", path / 3600, "h"),
            Measure(f"{name}_hours_{cores}_cores", span / 3600, "h"),
        ]
    return rows


def long_jobs(plan: Plan, domain: str, costs: Mapping[str, float], refined: str | None) -> dict[str, Job]:
    """The jobs of a plan that the figures need; all but the domain's long stages take no time.

    Args:
        plan: of the configuration.
        domain: its name.
        costs: stage (train_<method> for a job of training) -> seconds of one job on one core.
        refined: method whose models are retrained on refined ranges.
    """
    costs = dict(costs)
    if refined is not None:
        costs |= {"refined_rollouts": costs["rollouts"], "refined_train": costs[f"train_{refined}"]}
    names: dict[tuple[str, str], str] = {}  # equal recipes under two labels are one job
    jobs = {}
    for label, recipe in plan.of_figures().items():
        if names.setdefault((recipe.stage, recipe.id), label) == label:
            # The commands of the validation cases are demonstrations, but few.
            long = label.split("/")[1:2] == [domain] and label != f"demonstrations/{domain}/pool"
            joins = any(role.startswith(PART) for role in recipe.upstream)  # ensembles, in no time
            cost = costs.get(_part(label), 0.0) if long and not joins else 0.0
            after = tuple(names[pair] for pair in recipe.upstream.values())
            jobs[label] = Job(cost, STAGES[recipe.stage].threads if cost > 0 else 1, after)
    return jobs


def _part(label: str) -> str:
    """Stage of a label, which parts of an ensemble share; for training with the name of the method."""
    stage, *rest = label.split("/")
    stage = stage.removesuffix("_part")
    return f"train_{rest[1]}" if stage == "train" else stage


def stage_hours(prefix: str, jobs: Mapping[str, Job], cores: int) -> list[Measure]:
    """Hours of each long stage alone on these cores, with its jobs in parallel, and of all of them.

    Args:
        prefix: of the measures' names.
        jobs: from `long_jobs`.
        cores: of this machine; hours of all stages are reported for two cores, too.
    """
    parts: dict[str, list[str]] = {}
    for label, job in jobs.items():
        if job.core_seconds > 0:
            part = _part(label)
            parts.setdefault("refined" if part.startswith("refined_") else part, []).append(label)
    rows = []
    for part, labels in parts.items():
        alone = {k: job if k in labels else replace(job, core_seconds=0.0) for k, job in jobs.items()}
        rows.append(Measure(f"{prefix}_{part}_hours", makespan(alone, cores) / 3600, "h"))
    rows.append(Measure(f"{prefix}_long_stages_core_hours", core_seconds(jobs) / 3600, "h"))
    for count in sorted({LEAST_CORES, cores}):
        path, span = critical_path(jobs, count), makespan(jobs, count)
        rows += [
            Measure(f"{prefix}_long_stages_critical_path_hours_on_{count}_cores", path / 3600, "h"),
            Measure(f"{prefix}_long_stages_hours_on_{count}_cores", span / 3600, "h"),
        ]
    return rows


def _demonstration(plan: Plan, domain: str, folders: Mapping[str, Path]) -> float:
    """Seconds per demonstration on the one core that the stage uses."""
    recipe = plan.recipes[f"demonstrations/{domain}"]
    few = DemonstrationsSettings.from_parts(recipe.settings(DemonstrationsSettings), count=_TASKS)
    config = values_of(few)
    with tempfile.TemporaryDirectory() as out:
        return seconds(lambda: demonstrations.produce(Run(config, folders, Path(out), 1))) / _TASKS


def _policy_hit(config: Domain, folders: Mapping[str, Path]) -> float:
    """Seconds per hit of a policy on one core, without the cost of PPO."""
    rng = np.random.default_rng(0)
    randomisation = config.randomisation
    conditions = pd.DataFrame(draw_conditions(randomisation, _POLICY_HITS, rng))
    scene, model = Scene.load(folders["scene"]), TrajectoryVae.load(folders["trajectory_model"])
    simulator = Simulator(scene, config.scene.domain, model, conditions, randomisation.start_error, 1)
    latents = rng.normal(size=(_POLICY_HITS, model.sizes.latent))
    rows = np.arange(_POLICY_HITS)
    simulator.rests(rows[:2], latents[:2], rng)  # compiles
    return seconds(lambda: simulator.rests(rows, latents, rng)) / _POLICY_HITS


def _vae_step(config: Domain, folders: Mapping[str, Path]) -> float:
    """Seconds of a training step of the trajectory model at the configured sizes."""
    settings = config.trajectory_model
    known = TrajectoryVae.load(folders["trajectory_model"]).sizes
    sizes = VaeSizes(known.waypoints, known.joints, settings.latent, settings.hidden, known.duration)
    flat = torch.randn(settings.batch, sizes.waypoints * sizes.joints)

    def of_steps(steps: int) -> TrajectoryModelSettings:
        return TrajectoryModelSettings.from_parts(settings, seed=0, duration_s=known.duration, steps=steps)

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # as the stage does
    try:
        train(flat, sizes, of_steps(2))  # warm up
        return seconds(lambda: train(flat, sizes, of_steps(_STEPS))) / _STEPS
    finally:
        torch.set_num_threads(threads)
