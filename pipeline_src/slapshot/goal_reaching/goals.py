"""Targets that a rig can reach: where commands of its recording lead."""

from dataclasses import dataclass

import numpy as np

from slapshot.adaptation.recorded import RecordedTask
from slapshot.arrays import Array
from slapshot.goal_reaching.rigs import Robot


@dataclass(frozen=True)
class Goals:
    """Of one object of a rig.

    Attributes:
        latents: (T, latent) recorded commands, no two alike.
        targets: (T, 2) m, where they lead without chance: what an oracle knows.
        elsewhere: (n, 2) m, where the recording's other commands were seen to lead.
    """

    latents: Array
    targets: Array
    elsewhere: Array


def goals_of(robot: Robot, task: RecordedTask, count: int, seed: list[int]) -> Goals:
    """Goals for one object, the same for everybody who asks: `count`, or half of its commands if fewer."""
    latents, first = np.unique(task.data["action"], axis=0, return_index=True)
    order = np.random.default_rng(seed).permutation(len(latents))
    chosen = order[: min(count, len(order) // 2)]
    known = latents[chosen].astype(float)
    targets = robot.certain(known, [task.object] * len(known))
    return Goals(known, targets, task.data["outcome"][first[order[len(chosen) :]]].astype(float))
