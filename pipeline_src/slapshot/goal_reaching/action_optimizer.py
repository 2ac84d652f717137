"""Optimisers of latents for targets: adapted ensembles, with or without a Gaussian belief."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.method import AdaptationMethod
from slapshot.arrays import Array
from slapshot.goal_reaching.expected_cost import (
    LARGEST_LATENT,
    Cost,
    believed_cost,
    cheapest,
    choose_by_gradient,
    draw_phi,
    predicted_cost,
)
from slapshot.goal_reaching.inverse import InverseModel, Standardisation
from slapshot.goal_reaching.rigs import batched

GRADIENT, MEAN_ONLY, INVERSE = "gradient", "gradient, means only", "inverse model"


class Chooser:
    """Chooses latents by gradient descent through the mean cost of an ensemble of any method."""

    def __init__(self, method: AdaptationMethod[Any], standardiser: Standardiser, candidates: Array) -> None:
        """Prepare.

        Args:
            method: the ensemble; its weights are not changed.
            standardiser: of its data.
            candidates: (C, latent) safe latents at which the search begins.
        """
        self._method, self._standardiser = method, standardiser
        self._to_action = Standardisation(standardiser.mean["action"], standardiser.scale["action"])
        corner = torch.full_like(self._to_action.mean, LARGEST_LATENT)
        self._bounds = self._to_action(-corner), self._to_action(corner)
        self._candidates = standardiser.standardise("action", candidates)

    def beliefs(self, seen: Mapping[str, Array]) -> list[Any]:
        """Beliefs after 0, 1, ..., n of the hits seen, (n, size) each."""
        names = ("state", "action", "outcome")
        one_task = (self._standardiser.standardise(name, seen[name])[None] for name in names)
        with torch.no_grad():
            return self._method.adapt(*(batched(x, self._method.models) for x in one_task))

    def latents(self, belief: Any, start: NDArray[np.floating], targets: Array) -> dict[str, Array]:
        """Optimiser -> latents (T, latent) for targets (T, 2) in m, given a belief about one task."""
        state, wanted = self._standardised(start, targets)
        return {GRADIENT: self._descend(predicted_cost(self._method, belief, state, wanted), len(targets))}

    def _standardised(self, start: NDArray[np.floating], targets: Array) -> tuple[Tensor, Tensor]:
        """Standardised start (ds,) and targets (1, T, do)."""
        standardise = self._standardiser.standardise
        return standardise("state", start), standardise("outcome", targets)[None]

    def _descend(self, cost: Cost, targets: int) -> Array:
        return self._back(choose_by_gradient(cost, self._candidates, 1, targets, self._bounds))

    def _back(self, action: Tensor) -> Array:
        return self._to_action.back(action)[0].double().numpy()


class BelievingChooser(Chooser):
    """Optimiser for a method with Gaussian beliefs and an inverse model."""

    def __init__(
        self,
        method: Kalman,
        standardiser: Standardiser,
        candidates: Array,
        inverse: InverseModel,
        draws: int,
        generator: torch.Generator,
    ) -> None:
        """As `Chooser`; expectations are over `draws` samples of phi."""
        super().__init__(method, standardiser, candidates)
        self._kalman, self._inverse = method, inverse
        self._draws, self._generator = draws, generator

    def latents(self, belief: KalmanBelief, start: NDArray[np.floating], targets: Array) -> dict[str, Array]:
        """Latents by gradient with and without uncertainty, and from the inverse models.

        Each inverse model proposes one latent; the one with the least expected cost over all models is used.
        """
        method = self._kalman
        state, wanted = self._standardised(start, targets)
        phi = draw_phi(method, belief, self._draws, self._generator)
        mean = draw_phi(method, belief, 1, self._generator)
        cost = believed_cost(method, phi, state, wanted)
        found = {
            GRADIENT: self._descend(cost, len(targets)),
            MEAN_ONLY: self._descend(believed_cost(method, mean, state, wanted), len(targets)),
        }
        with torch.no_grad():
            answers = self._inverse(belief, wanted.expand(method.models, *wanted.shape))
            actions = self._to_action(answers).permute(1, 2, 0, 3)  # (B, T, M, latent)
            found[INVERSE] = self._back(cheapest(cost(actions), actions))
        return found
