"""Block `regression`: the paper's walkthrough."""

from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.methods import KalmanSettings
from slapshot.config.values import (
    LearningRate,
    Models,
    Name,
    PositiveRatio,
    Samples,
    Seed,
    Several,
    Steps,
)
from slapshot.validation import Model, ProblemAtError

_DRAWN = 2  # dimension of the ellipses in figure F3


class WalkthroughKalman(KalmanSettings):
    """The Kalman filter of the walkthrough."""

    latent: Annotated[int, Field(ge=2, le=1_000)] = Field(
        description="dimension of phi; the first two components are plotted"
    )


class WalkthroughTraining(Model):
    """Meta-training of the walkthrough."""

    models: Models = Field(description="number of models of an ensemble")
    steps: Steps = Field(description="of the optimiser")
    tasks: Annotated[int, Field(ge=1, le=100_000)] = Field(description="lines per step")
    sequence: Annotated[int, Field(ge=1, le=10_000)] = Field(description="samples of each line per step")
    learning_rate: LearningRate = Field(description="of Adam")
    noise_variance_max: Annotated[float, Field(gt=0, le=100)] = Field(description="of the observed y")


class Walkthrough(Model):
    """The part of the walkthrough that shows a single line."""

    samples: Samples = Field(description="numbers of samples to adapt to")
    noise_variance: Annotated[float, Field(gt=0, le=100)] = Field(description="of the observed y")


class RegressionSettings(Model):
    """Settings of the stage `regression`."""

    seed: Seed = Field(description="of every random draw")
    slope_sd: PositiveRatio = Field(description="standard deviation of w")
    intercept_sd: PositiveRatio = Field(description="standard deviation of b")
    x_range: PositiveRatio = Field(description="x ~ U(-x_range, x_range)")
    kalman: WalkthroughKalman = Field(description="settings of the method")
    training: WalkthroughTraining = Field(description="its meta-training")
    walkthrough: Walkthrough = Field(description="the part that shows a single line")
    tasks: Annotated[int, Field(ge=1, le=10_000)] = Field(description="number of test tasks")


class Regression(RegressionSettings):
    """Regression of lines y = w x + b from noisy samples."""

    figures: Several[Name] = Field(description="F3, or none")
    claims: Several[Name] = Field(description="C1, or none")

    @model_validator(mode="after")
    def _can_be_drawn(self) -> "Regression":
        if "F3" in self.figures and self.kalman.latent != _DRAWN:
            raise ProblemAtError(
                ("kalman", "latent"),
                f"{self.kalman.latent} dimensions cannot be drawn in F3; write {_DRAWN}, or remove F3 from "
                "regression.figures",
            )
        return self
