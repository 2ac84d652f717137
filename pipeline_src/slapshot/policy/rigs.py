"""Stage `policy_acting`: a policy that adapts to a rig with its own hits there."""

import logging

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.recorded import RecordedTask, recorded_tasks
from slapshot.command import Run, stage_command
from slapshot.config.acting import PolicyActingSettings
from slapshot.goal_reaching.expected_cost import LARGEST_LATENT
from slapshot.goal_reaching.goals import goals_of
from slapshot.goal_reaching.rigs import Robot, robot_of
from slapshot.parquet import write_table
from slapshot.policy.adapt import update
from slapshot.policy.network import GaussianPolicy, load_policy
from slapshot.policy.ppo import own_hits

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write policy.parquet: rig, object, policy, hits, target, target_x_m, target_y_m, error_m.

    Targets are those of the stage `acting`; the policy hits at them with its mean action. It adapts with hits
    of its own, which are drawn from the policy and aimed at rest points of other recorded hits; the column
    `hits` counts only these.
    """
    settings = run.settings(PolicyActingSettings)
    torch.set_num_threads(run.cores)
    robot = robot_of(settings, run.inputs, run.cores)
    policy = load_policy(run.inputs["policy"], settings.policy)
    standardiser = Standardiser.load(run.inputs["policy"] / "standardiser.safetensors")
    rng = np.random.default_rng([settings.seed, settings.rig, 2])
    parts = [
        _errors(policy, standardiser, robot, task, settings, rng)
        for task in recorded_tasks(settings, run.inputs)
    ]
    table = pd.concat(parts, ignore_index=True).assign(rig=settings.rig, policy=settings.number)
    write_table(table, run.out / "policy.parquet")
    means = 100 * table.groupby("hits")["error_m"].mean()
    log.info("%s", ", ".join(f"{error:.1f} cm after {hits}" for hits, error in means.items()))


def _errors(
    policy: GaussianPolicy,
    standardiser: Standardiser,
    robot: Robot,
    task: RecordedTask,
    settings: PolicyActingSettings,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Errors for one object, before any update and after each."""
    goals = goals_of(robot, task, settings.targets, [settings.seed, settings.rig])
    standardise = standardiser.standardise
    wanted = standardise("outcome", goals.targets)[None]
    generator = torch.Generator().manual_seed(int(rng.integers(2**31)))

    def hit(latents: Tensor) -> NDArray[np.float64]:
        """Rest points (n, 2) in m of latents (1, n, latent), clipped as in simulation."""
        within = latents[0].clamp(-LARGEST_LATENT, LARGEST_LATENT).double().numpy()
        return robot.hit(within, [task.object] * len(within), rng)

    parameters, parts = policy.unadapted(1), []
    each = settings.policy.hits
    for updates in range(settings.policy.updates_on_rigs + 1):
        if updates:
            aims = goals.elsewhere[rng.integers(len(goals.elsewhere), size=each)]
            targets = standardise("outcome", aims)[None]
            hits = own_hits(
                policy, parameters, targets, lambda z: standardise("outcome", hit(z))[None], generator
            )
            parameters = update(policy, parameters, hits, differentiable=False)
        with torch.no_grad():
            rests = hit(policy.distribution(parameters, wanted).mean)
        parts.append(
            pd.DataFrame(
                {
                    "object": task.object,
                    "hits": updates * each,
                    "target": range(len(rests)),
                    "target_x_m": goals.targets[:, 0],
                    "target_y_m": goals.targets[:, 1],
                    "error_m": np.linalg.norm(rests - goals.targets, axis=1),
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


if __name__ == "__main__":
    stage_command("policy_acting", produce)
