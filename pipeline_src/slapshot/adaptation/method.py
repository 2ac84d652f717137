"""Interface of all adaptation methods, and how one is found by its name.

Every parameter has a leading dimension M (independent models, trained together), every data tensor
is (M, B, N, d): M models, B tasks, N samples in a sequence. All inputs are standardised by the
caller, so nothing here has a physical unit.
"""

import dataclasses
import importlib
import pkgutil
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Generic, TypeVar

import torch
from torch import Tensor, nn

import slapshot.adaptation
from slapshot.adaptation.names import method_file
from slapshot.errors import InputError
from slapshot.validation import Model

BeliefT = TypeVar("BeliefT")
"""What a method knows about B tasks per model: a frozen dataclass of tensors (M, B, ...)."""


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Dimensions of one sample: state s, action a, and outcome s' (or its noisy observation)."""

    state: int
    action: int
    outcome: int


class AdaptationMethod(nn.Module, ABC, Generic[BeliefT]):
    """A model f(s_i, a_i, phi_{i-1}) whose hidden state phi_{i-1} = g(D_{i-1}) adapts to the data.

    `predict` is f, `update` extends g by one sample. Eq. (1) of the paper fixes the order: the
    prediction for sample i uses the belief from the samples before it. A subclass implements the
    abstract methods and may replace the two loops, `sequence_predictions` and `adapt`, by faster code
    with the same result.
    """

    Settings: ClassVar[type[Model]]
    """The model of the method's own settings."""

    settings: Model

    def __init__(self, sizes: Sizes, settings: Model, models: int, generator: torch.Generator):
        """Draw weights from the generator, on the CPU."""
        super().__init__()
        self.sizes = sizes
        self.settings = settings
        self.models = models

    @abstractmethod
    def prior(self, tasks: int) -> BeliefT:
        """Return the belief about B = `tasks` tasks before any sample."""

    @abstractmethod
    def update(self, belief: BeliefT, state: Tensor, action: Tensor, observed: Tensor) -> BeliefT:
        """Return the belief after one more sample (s, a, s~') per task, each (M, B, d)."""

    @abstractmethod
    def predict(self, belief: BeliefT, state: Tensor, action: Tensor) -> Tensor:
        """Predict (M, B, Q, do) outcomes for Q queries per task, state and action (M, B, Q, d)."""

    @abstractmethod
    def hidden(self, belief: BeliefT) -> Tensor:
        """Return the (M, B, h) vector that represents the belief in a latent analysis."""

    def adapt(self, state: Tensor, action: Tensor, observed: Tensor) -> list[BeliefT]:
        """Return the N + 1 beliefs after 0, 1, ..., N samples of sequences (M, B, N, d)."""
        beliefs = [self.prior(state.shape[1])]
        for i in range(state.shape[2]):
            sample = (state[:, :, i], action[:, :, i], observed[:, :, i])
            beliefs.append(self.update(beliefs[-1], *sample))
        return beliefs

    def sequence_predictions(self, state: Tensor, action: Tensor, observed: Tensor) -> Tensor:
        """Predict each outcome of a sequence from the samples before it.

        s^'_i = f(s_i, a_i, phi_{i-1}),   phi_{i-1} = g(D_{i-1}),   i = 0, ..., N - 1

        Prediction i uses samples 0, ..., i - 1 only; prediction 0 is made from the prior. Inputs are
        (M, B, N, d), the result is (M, B, N, do).
        """
        belief = self.prior(state.shape[1])
        predictions = []
        for i in range(state.shape[2]):
            query = slice(i, i + 1)
            predictions.append(self.predict(belief, state[:, :, query], action[:, :, query]))
            # No prediction follows the last observation.
            if i + 1 < state.shape[2]:
                sample = (state[:, :, i], action[:, :, i], observed[:, :, i])
                belief = self.update(belief, *sample)
        return torch.cat(predictions, dim=2)

    @staticmethod
    def model_losses(predictions: Tensor, outcome: Tensor) -> Tensor:
        """Mean squared error of each model over its tasks, samples and outcome components, (M,).

        Eq. (loss): L = 1/N sum_i (s^'_i - s'_i)^2, with s' free of noise and the prediction from
        the prior included; further averaged over the B tasks and the do components.
        """
        return (predictions - outcome).square().mean(dim=(1, 2, 3))

    @staticmethod
    def sequence_loss(predictions: Tensor, outcome: Tensor) -> Tensor:
        """Training loss: eq. (loss) of each model, summed over the M models.

        The sum, not the mean: the gradient of model m is then that of its own loss, whatever M is.
        """
        return AdaptationMethod.model_losses(predictions, outcome).sum()

    def parameter_count(self) -> int:
        """Return the number of trained parameters of one model."""
        return sum(p.numel() for p in self.parameters() if p.requires_grad) // self.models


def load_method(name: str) -> type[AdaptationMethod[Any]]:
    """Return the class `METHOD` of the file slapshot/adaptation/<method_file(name)>.py."""
    file = method_file(name)
    method = _method_in(file) if file in _modules() else None
    if method is None:
        known = [module for module in _modules() if _method_in(module)]
        raise InputError(f"unknown adaptation method {name!r}; there are: {', '.join(known)}")
    return method


def _modules() -> list[str]:
    return sorted(module.name for module in pkgutil.iter_modules(slapshot.adaptation.__path__))


def _method_in(module: str) -> type[AdaptationMethod[Any]] | None:
    loaded = importlib.import_module(f"{slapshot.adaptation.__name__}.{module}")
    return getattr(loaded, "METHOD", None)
