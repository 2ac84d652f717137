"""Block `acting`: hits at targets and hits to learn from, on the stand-in rigs of a recording."""

from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.lab import Lab
from slapshot.config.methods import Training
from slapshot.config.randomisation import Draw
from slapshot.config.sources import RecordedTasksSettings
from slapshot.config.values import (
    Few,
    Hits,
    LearningRate,
    Models,
    Name,
    PositiveRatio,
    Samples,
    Seed,
    Several,
    Steps,
    Widths,
)
from slapshot.validation import Model, ProblemAtError

_Draws = Annotated[int, Field(ge=2, le=10_000)]


class Inverse(Model):
    """A network from a target and a belief to a latent."""

    hidden: Widths = Field(description="widths of hidden layers")
    steps: Steps = Field(description="of the optimiser")
    learning_rate: LearningRate = Field(description="of Adam")
    draws: _Draws = Field(description="of phi")


class InverseSettings(Model):
    """What the stage `inverse` is told."""

    seed: Seed
    inverse: Inverse
    training: Training


class Exploration(Model):
    """Error against samples that a belief chooses."""

    samples: Hits = Field(description="hits, at most")
    repeats: Few = Field(description="random splits, of sampled latents")
    candidates: Hits = Field(description="recorded hits to choose from")
    asked: Hits = Field(description="latents whose outcomes are to be predicted well")

    @model_validator(mode="after")
    def _enough_candidates(self) -> "Exploration":
        if self.samples > self.candidates:
            raise ProblemAtError(
                ("samples",),
                f"{self.samples} hits cannot be chosen from {self.candidates} candidates; lower the first or "
                "raise the second",
            )
        return self


class PolicyTraining(Model):
    """Meta-training of a policy."""

    hidden: Widths = Field(description="widths of hidden layers")
    hits: Annotated[int, Field(ge=2, le=10_000)] = Field(description="K, own hits of an update")
    updates: Few = Field(description="in training")
    step_size: PositiveRatio = Field(description="of an update, before training")
    tasks: Hits = Field(description="conditions of an iteration of training")
    epochs: Few = Field(description="steps of PPO's optimiser on an iteration's hits")
    learning_rate: LearningRate = Field(description="of Adam")


class Policy(PolicyTraining):
    """Policy adaptation (S4); as many hits in training as the rollouts have for it."""

    models: Models = Field(description="which rigs meet in turn")
    updates_on_rigs: Few = Field(description="on every rig")


class StartError(Model):
    """What is drawn anew for every hit."""

    start_error: Draw


class PolicySettings(Model):
    """What the stage `policy` is told."""

    domain: str
    seed: Seed
    number: Annotated[int, Field(ge=0)]
    randomisation: StartError
    policy: PolicyTraining


class HitsAtTargets(Model):
    """Hits at targets by adapted models."""

    method: Name = Field(description="one of methods, with a belief")
    compared: Several[Name] = Field(description="others of methods")
    samples: Samples = Field(description="numbers of hits seen")
    targets: Hits = Field(description="of each object")
    candidates: Hits = Field(description="latents that the gradient may begin at")
    draws: _Draws = Field(description="of phi, for an expected distance")
    inverse: Inverse = Field(description="a network from a target and a belief to a latent")


class Acting(HitsAtTargets):
    """What adapted models and policies do on stand-in rigs."""

    recording: Name = Field(description="name of one that stand-in rigs made")
    exploration: Exploration = Field(description="error against samples that a belief chooses")
    policy: Policy = Field(description="the method that the paper compares with")

    @model_validator(mode="after")
    def _others(self) -> "Acting":
        if self.method in self.compared:
            raise ProblemAtError(("compared",), f"{self.method!r} is `method` itself; name others or none")
        return self


class RobotSettings(RecordedTasksSettings):
    """What every stage is told that hits a stand-in rig anew; its recording is that of the rig."""

    domain: str
    seed: Seed
    rig: Annotated[int, Field(ge=0)]
    lab: Lab


class ActingSettings(HitsAtTargets, RobotSettings):
    """What the stage `acting` is told."""


class PolicyActingSettings(RobotSettings):
    """What the stage `policy_acting` is told; `number` is the policy's."""

    number: Annotated[int, Field(ge=0)]
    policy: Policy
    targets: Hits


class ExplorationSettings(Exploration, RecordedTasksSettings):
    """What the stage `exploration` is told."""

    method: Name
    seed: Seed
