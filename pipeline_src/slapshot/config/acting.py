"""Block `acting`: hits at targets and hits to learn from, on the stand-in rigs of a recording."""

from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.values import (
    Few,
    LearningRate,
    Models,
    Name,
    PositiveRatio,
    Samples,
    Several,
    Steps,
    Widths,
)
from slapshot.validation import Model, ProblemAtError

_Draws = Annotated[int, Field(ge=2, le=10_000)]
_Hits = Annotated[int, Field(ge=1, le=10_000)]


class Inverse(Model):
    """A network from a target and a belief to a latent."""

    hidden: Widths = Field(description="widths of hidden layers")
    steps: Steps = Field(description="of the optimiser")
    learning_rate: LearningRate = Field(description="of Adam")
    draws: _Draws = Field(description="of phi")


class Exploration(Model):
    """Error against samples that a belief chooses."""

    samples: _Hits = Field(description="hits, at most")
    repeats: Few = Field(description="random splits, of sampled latents")
    candidates: _Hits = Field(description="recorded hits to choose from")
    asked: _Hits = Field(description="latents whose outcomes are to be predicted well")

    @model_validator(mode="after")
    def _enough_candidates(self) -> "Exploration":
        if self.samples > self.candidates:
            raise ProblemAtError(
                ("samples",),
                f"{self.samples} hits cannot be chosen from {self.candidates} candidates; lower the first or "
                "raise the second",
            )
        return self


class Policy(Model):
    """Policy adaptation (S4); as many hits in training as the rollouts have for it."""

    models: Models = Field(description="which rigs meet in turn")
    hidden: Widths = Field(description="widths of hidden layers")
    hits: Annotated[int, Field(ge=2, le=10_000)] = Field(description="K, own hits of an update")
    updates: Few = Field(description="in training")
    updates_on_rigs: Few = Field(description="on every rig")
    step_size: PositiveRatio = Field(description="of an update, before training")
    tasks: _Hits = Field(description="conditions of an iteration of training")
    epochs: Few = Field(description="steps of PPO's optimiser on an iteration's hits")
    learning_rate: LearningRate = Field(description="of Adam")


class Acting(Model):
    """What adapted models and policies do on stand-in rigs."""

    recording: Name = Field(description="name of one that stand-in rigs made")
    method: Name = Field(description="one of methods, with a belief")
    compared: Several[Name] = Field(description="others of methods")
    samples: Samples = Field(description="numbers of hits seen")
    targets: _Hits = Field(description="of each object")
    candidates: _Hits = Field(description="latents that the gradient may begin at")
    draws: _Draws = Field(description="of phi, for an expected distance")
    inverse: Inverse = Field(description="a network from a target and a belief to a latent")
    exploration: Exploration = Field(description="error against samples that a belief chooses")
    policy: Policy = Field(description="the method that the paper compares with")

    @model_validator(mode="after")
    def _others(self) -> "Acting":
        if self.method in self.compared:
            raise ProblemAtError(("compared",), f"{self.method!r} is `method` itself; name others or none")
        return self
