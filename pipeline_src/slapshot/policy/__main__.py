"""Stage `policy`: meta-train one policy on-policy, with as many hits as the rollouts have for training."""

import logging
from collections.abc import Iterator

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from slapshot.adaptation.data import Standardiser
from slapshot.command import Run, stage_command
from slapshot.config.acting import PolicySettings, PolicyTraining
from slapshot.policy.network import GaussianPolicy
from slapshot.policy.ppo import train
from slapshot.policy.simulator import Simulator
from slapshot.rollouts.reading import Sequences, read_sequences
from slapshot.scenes.scene import Scene
from slapshot.trajectories.vae import TrajectoryVae

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write policy.safetensors, standardiser.safetensors and distances.csv (iteration, updates, distance).

    Tasks are the training conditions of the rollouts; targets are rest points of their hits, so that all can
    be reached.
    """
    told = run.settings(PolicySettings)
    settings = told.policy
    torch.set_num_threads(run.cores)
    data = read_sequences(run.inputs["rollouts"], "train")
    standardiser = Standardiser.fit(data)
    simulator = Simulator(
        Scene.load(run.inputs["scene"]),
        told.domain,
        TrajectoryVae.load(run.inputs["trajectory_model"]),
        data.conditions,
        told.randomisation.start_error,
        run.cores,
    )
    rng = np.random.default_rng([told.seed, told.number])
    generator = torch.Generator().manual_seed(int(rng.integers(2**31)))

    def act(conditions: Tensor, latents: Tensor) -> Tensor:
        tasks, hits, size = latents.shape
        rows = np.repeat(conditions.numpy(), hits)
        rests = simulator.rests(rows, latents.reshape(-1, size).double().numpy(), rng)
        return standardiser.standardise("outcome", rests).reshape(tasks, hits, -1)

    policy = GaussianPolicy(data.outcome.shape[2], data.action.shape[2], settings, generator)
    conditions, hits, _ = data.outcome.shape
    budget = conditions * hits
    each = settings.tasks * settings.hits * (settings.updates + 1)
    iterations = max(1, budget // each)
    table = train(
        policy, tasks(data, standardiser, settings, generator), iterations, act, settings, generator
    )
    policy.save(run.out)
    standardiser.save(run.out / "standardiser.safetensors")
    table.to_csv(run.out / "distances.csv", index=False, float_format="%.6g")
    last = table[table["iteration"] >= iterations - max(1, iterations // 10)]
    log.info("%d hits; distance after each number of updates: %s", iterations * each, _in_words(last))


def _in_words(table: pd.DataFrame) -> str:
    return ", ".join(f"{d:.2f}" for d in table.groupby("updates")["distance"].mean())


def tasks(
    data: Sequences, standardiser: Standardiser, settings: PolicyTraining, generator: torch.Generator
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield conditions (B,) and targets (U + 1, B, K, 2) of each iteration.

    No condition is repeated before all have been used.
    """
    outcome = standardiser.standardise("outcome", data.outcome)
    conditions, hits, _ = outcome.shape
    shape = (settings.updates + 1, min(settings.tasks, conditions), settings.hits)
    while True:
        order = torch.randperm(conditions, generator=generator)
        for begin in range(0, conditions - shape[1] + 1, shape[1]):
            chosen = order[begin : begin + shape[1]]
            yield chosen, outcome[chosen[:, None], torch.randint(hits, shape, generator=generator)]


if __name__ == "__main__":
    stage_command("policy", produce)
