"""Blocks `demonstrations`, `trajectory_model` and `swings` of a domain: the generation of commands."""

from typing import Annotated

from pydantic import Field

from slapshot.config.values import (
    Box,
    Count,
    Duration,
    Interval,
    LearningRate,
    MayMiss,
    Seed,
    Speed,
    Steps,
    Waypoints,
    Widths,
)
from slapshot.validation import Model


class ScriptedHits(Model):
    """Ranges of the domain's tasks: heading, speed and contact point of a hit."""

    heading_rad: Annotated[float, Field(ge=0, le=1.58)] = Field(
        description="largest angle to either side of straight ahead"
    )
    speed_m_s: Interval[Speed] = Field(description="of the striker at contact, lowest and highest")
    contact_offset_m: Annotated[float, Field(ge=0, le=0.115)] = Field(
        description="largest distance of the contact point from the striker's centre"
    )
    duration_s: Duration = Field(description="of a motion")
    waypoints: Waypoints = Field(description="number of waypoints of a motion, equally spaced in time")
    place_m: MayMiss[Box] = Field(
        default=None,
        description="range of the object's start in domains that vary it: lowest and highest x, then y",
    )


class Demonstrations(ScriptedHits):
    """Scripted hits that the trajectory model learns from."""

    count: Annotated[int, Field(ge=64, le=10_000_000)] = Field(description="number of attempts")


class Pool(ScriptedHits):
    """Demonstrations that commands are drawn from."""

    count: Annotated[int, Field(ge=1, le=100_000)] = Field(description="number of demonstrations")


class DemonstrationsSettings(ScriptedHits):
    """Settings of the stage `demonstrations`."""

    domain: str
    seed: Seed
    count: Count


class TrajectoryModel(Model):
    """A variational autoencoder over motions."""

    latent: Annotated[int, Field(ge=1, le=100)] = Field(description="dimension of a latent")
    hidden: Widths = Field(description="widths of hidden layers")
    steps: Steps = Field(description="of the optimiser")
    batch: Annotated[int, Field(ge=1, le=1_000_000)] = Field(description="demonstrations per step")
    learning_rate: LearningRate = Field(description="of Adam")
    noise: Annotated[float, Field(gt=0, le=10)] = Field(
        description="standard deviation of the decoder, in the unit of waypoints"
    )


class TrajectoryModelSettings(TrajectoryModel):
    """Settings of the stage `trajectory_model`."""

    seed: Seed
    duration_s: Duration


class Splits(Model):
    """Sizes of the three splits."""

    train: Count = Field(description="number for training")
    validation: Count = Field(description="number for calibration")
    test: Count = Field(description="number for evaluation")

    def count(self, split: str) -> int:
        """Size of the split `split`."""
        return {"train": self.train, "validation": self.validation, "test": self.test}[split]


class Swings(Splits):
    """Sampled latents, each executed once, of the three splits."""


class SwingsSettings(Swings):
    """Settings of the stage `swings`."""

    domain: str
    seed: Seed
