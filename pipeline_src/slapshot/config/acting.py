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
    """A network that maps a target and a belief to a latent."""

    hidden: Widths = Field(description="widths of hidden layers")
    steps: Steps = Field(description="of the optimiser")
    learning_rate: LearningRate = Field(description="of Adam")
    draws: _Draws = Field(description="samples of phi")


class InverseSettings(Model):
    """Settings of the stage `inverse`."""

    seed: Seed
    inverse: Inverse
    training: Training


class Exploration(Model):
    """Error against number of samples, for hits that are chosen by means of the belief."""

    samples: Hits = Field(description="largest number of hits to adapt to")
    repeats: Few = Field(description="random splits of the sampled latents")
    candidates: Hits = Field(description="recorded hits to choose from")
    asked: Hits = Field(description="latents whose outcomes are to be predicted")

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
    hits: Annotated[int, Field(ge=2, le=10_000)] = Field(description="K, hits of the policy per update")
    updates: Few = Field(description="adaptation steps in training")
    step_size: PositiveRatio = Field(description="of an adaptation step, before it is learned")
    tasks: Hits = Field(description="conditions per iteration of training")
    epochs: Few = Field(description="steps of PPO's optimiser on the hits of an iteration")
    learning_rate: LearningRate = Field(description="of Adam")


class Policy(PolicyTraining):
    """Policy adaptation (S4), trained with as many hits as the rollouts have for training."""

    models: Models = Field(description="trained policies, which are assigned to the rigs in turn")
    updates_on_rigs: Few = Field(description="adaptation steps on every rig")


class StartError(Model):
    """Randomisation that is drawn for every hit."""

    start_error: Draw


class PolicySettings(Model):
    """Settings of the stage `policy`."""

    domain: str
    seed: Seed
    number: Annotated[int, Field(ge=0)]
    randomisation: StartError
    policy: PolicyTraining


class HitsAtTargets(Model):
    """Hits at targets with adapted models."""

    method: Name = Field(description="one of `methods`, with a belief")
    compared: Several[Name] = Field(description="other methods to compare with")
    samples: Samples = Field(description="numbers of hits to adapt to")
    targets: Hits = Field(description="for each object")
    candidates: Hits = Field(description="latents among which gradient descent chooses its initial value")
    draws: _Draws = Field(description="samples of phi, for the expected distance to the target")
    inverse: Inverse = Field(description="a network that maps a target and a belief to a latent")


class Acting(HitsAtTargets):
    """Goal-reaching and exploration with adapted models and policies on stand-in rigs."""

    recording: Name = Field(description="name of a recording of stand-in rigs")
    exploration: Exploration = Field(description="error against number of samples, for hits chosen by belief")
    policy: Policy = Field(description="policy adaptation, with which the paper compares")

    @model_validator(mode="after")
    def _others(self) -> "Acting":
        if self.method in self.compared:
            raise ProblemAtError(("compared",), f"{self.method!r} is `method` itself; name others or none")
        return self


class RobotSettings(RecordedTasksSettings):
    """Settings of every stage that executes new hits on a stand-in rig; the recording is the rig's own."""

    domain: str
    seed: Seed
    rig: Annotated[int, Field(ge=0)]
    lab: Lab


class ActingSettings(HitsAtTargets, RobotSettings):
    """Settings of the stage `acting`."""


class PolicyActingSettings(RobotSettings):
    """Settings of the stage `policy_acting`; `number` is that of the policy."""

    number: Annotated[int, Field(ge=0)]
    policy: Policy
    targets: Hits


class ExplorationSettings(Exploration, RecordedTasksSettings):
    """Settings of the stage `exploration`."""

    method: Name
    seed: Seed
