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

_DRAWN = 2  # dimensions of the ellipses in figure F3


class WalkthroughKalman(KalmanSettings):
    """The Kalman filter of the walkthrough."""

    latent: Annotated[int, Field(ge=2, le=1_000)] = Field(
        description="dimension of phi; the first two are drawn"
    )


class WalkthroughTraining(Model):
    """Meta-training of the walkthrough."""

    models: Models = Field(description="of an ensemble")
    steps: Steps = Field(description="of the optimiser")
    tasks: Annotated[int, Field(ge=1, le=100_000)] = Field(description="lines of a step")
    sequence: Annotated[int, Field(ge=1, le=10_000)] = Field(description="samples of a line in a step")
    learning_rate: LearningRate = Field(description="of Adam")
    noise_variance_max: Annotated[float, Field(gt=0, le=100)] = Field(description="of the observed y")


class Walkthrough(Model):
    """What the walkthrough shows of one line."""

    samples: Samples = Field(description="numbers of samples seen")
    noise_variance: Annotated[float, Field(gt=0, le=100)] = Field(description="of the observed y")


class RegressionSettings(Model):
    """What the stage `regression` is told."""

    seed: Seed = Field(description="of all that is drawn")
    slope_sd: PositiveRatio = Field(description="standard deviation of w")
    intercept_sd: PositiveRatio = Field(description="standard deviation of b")
    x_range: PositiveRatio = Field(description="x ~ U(-x_range, x_range)")
    kalman: WalkthroughKalman = Field(description="settings of the method")
    training: WalkthroughTraining = Field(description="how it is trained")
    walkthrough: Walkthrough = Field(description="what is shown of one line")
    tasks: Annotated[int, Field(ge=1, le=10_000)] = Field(description="test tasks")


class Regression(RegressionSettings):
    """Lines y = w x + b from noisy samples."""

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
