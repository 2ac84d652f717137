"""Informed exploration: the next hit is the one expected to reduce predictive variance the most.

It is chosen among recorded hits, and other recorded hits are predicted, so that the strategy can be evaluated
on any recording; on a robot the chosen hit would be executed instead.
"""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.goal_reaching.uncertainty import outcome_jacobian, variance_after

Choice = Callable[[KalmanBelief, Tensor], Tensor]
"""From a belief and (M, B, C) which candidates are used up, to (M, B) the number of the next one."""


def informed(method: Kalman, candidates: Mapping[str, Tensor], asked: tuple[Tensor, Tensor]) -> Choice:
    """Choose by expected reduction of the predictive variance over the hits of interest.

    No candidate is taken twice: the model error of a rig is the same in repeats of a command, but the filter
    assumes independent measurements.

    Args:
        method: an ensemble of M models.
        candidates: state and action of C hits, (M, B, C, d).
        asked: state and action (M, B, Q, d) of hits representative of those that are to be predicted.
    """

    def choose(belief: KalmanBelief, used: Tensor) -> Tensor:
        jacobian = outcome_jacobian(method, belief, *asked)
        left = variance_after(method, belief, jacobian, candidates["state"], candidates["action"])
        return left.masked_fill(used, torch.inf).argmin(-1)

    return choose


def at_random(generator: torch.Generator) -> Choice:
    """Choose uniformly among unused candidates: latent sampling."""

    def choose(belief: KalmanBelief, used: Tensor) -> Tensor:
        drawn = torch.rand(used.shape, generator=generator)
        return drawn.masked_fill(used, -1.0).argmax(-1)

    return choose


@torch.no_grad()
def explore(
    method: Kalman, candidates: Mapping[str, Tensor], choose: Choice, samples: int
) -> list[KalmanBelief]:
    """Beliefs after 0, 1, ..., `samples` hits; each model chooses its own hits.

    Args:
        method: an ensemble of M models.
        candidates: state, action and outcome of C hits of each of B tasks, (M, B, C, d).
        choose: the next hit.
        samples: number of hits, at most C.
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
