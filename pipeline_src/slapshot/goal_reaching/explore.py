"""Informed exploration: the next hit is that after which predictions should be surest.

It is chosen among hits that were recorded, and what is predicted are others of them, so that it can be tried
on any recording; a robot at hand would make the hit instead.
"""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.goal_reaching.uncertainty import outcome_jacobian, variance_after

Choice = Callable[[KalmanBelief, Tensor], Tensor]
"""From a belief and (M, B, C) which candidates are used up, to (M, B) the number of the next one."""


def informed(method: Kalman, candidates: Mapping[str, Tensor], asked: tuple[Tensor, Tensor]) -> Choice:
    """Choose by expected reduction of the predictive variance over hits that may be asked for.

    No candidate is taken twice: what a rig does otherwise than the simulator is alike in repeats of a
    command, which the filter takes for independent.

    Args:
        method: an ensemble of M models.
        candidates: state and action of C hits, (M, B, C, d).
        asked: state and action (M, B, Q, d) of hits like all that a robot may be asked for.
    """

    def choose(belief: KalmanBelief, used: Tensor) -> Tensor:
        jacobian = outcome_jacobian(method, belief, *asked)
        left = variance_after(method, belief, jacobian, candidates["state"], candidates["action"])
        return left.masked_fill(used, torch.inf).argmin(-1)

    return choose


def at_random(generator: torch.Generator) -> Choice:
    """Latent sampling: any candidate that is left."""

    def choose(belief: KalmanBelief, used: Tensor) -> Tensor:
        drawn = torch.rand(used.shape, generator=generator)
        return drawn.masked_fill(used, -1.0).argmax(-1)

    return choose


@torch.no_grad()
def explore(
    method: Kalman, candidates: Mapping[str, Tensor], choose: Choice, samples: int
) -> list[KalmanBelief]:
    """Beliefs after 0, 1, ..., `samples` hits, each model choosing its own.

    Args:
        method: an ensemble of M models.
        candidates: state, action and outcome of C hits of each of B tasks, (M, B, C, d).
        choose: the next one.
        samples: at most C.
    """
    models, tasks, count, _ = candidates["action"].shape
    beliefs = [method.prior(tasks)]
    used = torch.zeros(models, tasks, count, dtype=torch.bool)
    for _ in range(samples):
        chosen = choose(beliefs[-1], used)[..., None]
        used = used.scatter(2, chosen, True)
        hit = {
            name: x.gather(2, chosen[..., None].expand(-1, -1, 1, x.shape[-1]))[:, :, 0]
            for name, x in candidates.items()
        }
        beliefs.append(method.update(beliefs[-1], hit["state"], hit["action"], hit["outcome"]))
    return beliefs
