"""Targets that a rig can reach: rest points of commands of its recording."""

from dataclasses import dataclass

import numpy as np

from slapshot.adaptation.recorded import RecordedTask
from slapshot.arrays import Array
from slapshot.goal_reaching.rigs import Robot


@dataclass(frozen=True)
class Goals:
    """Targets for one object of a rig.

    Attributes:
        latents: (T, latent) distinct recorded commands.
        targets: (T, 2) m, their noiseless rest points, which only an oracle knows.
        elsewhere: (n, 2) m, observed rest points of the recording's other commands.
    """

    latents: Array
    targets: Array
    elsewhere: Array


def goals_of(robot: Robot, task: RecordedTask, count: int, seed: list[int]) -> Goals:
    """Goals for one object, determined by the seed: `count`, or half of its commands if that is fewer."""
    latents, first = np.unique(task.data["action"], axis=0, return_index=True)
    order = np.random.default_rng(seed).permutation(len(latents))
    chosen = order[: min(count, len(order) // 2)]
    known = latents[chosen].astype(float)
    targets = robot.certain(known, [task.object] * len(known))
    return Goals(known, targets, task.data["outcome"][first[order[len(chosen) :]]].astype(float))
