"""Blocks `demonstrations`, `trajectory_model` and `swings` of a domain: how commands come about."""

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
    """Tasks of the domain: where a hit goes, how hard, and where the striker meets the object."""

    heading_rad: Annotated[float, Field(ge=0, le=1.58)] = Field(
        description="largest angle to either side of straight ahead"
    )
    speed_m_s: Interval[Speed] = Field(description="of the striker at contact, lowest and highest")
    contact_offset_m: Annotated[float, Field(ge=0, le=0.115)] = Field(
        description="largest distance of the point of contact from the striker's middle"
    )
    duration_s: Duration = Field(description="of a motion")
    waypoints: Waypoints = Field(description="of a motion, at equal times")
    place_m: MayMiss[Box] = Field(
        default=None,
        description="where the object lies, of a domain in which that differs: lowest and highest x, then y",
    )


class Demonstrations(ScriptedHits):
    """Scripted hits that the trajectory model learns from."""

    count: Annotated[int, Field(ge=64, le=10_000_000)] = Field(description="how many are tried")


class Pool(ScriptedHits):
    """Demonstrations that commands are drawn from."""

    count: Annotated[int, Field(ge=1, le=100_000)] = Field(description="how many")


class DemonstrationsSettings(ScriptedHits):
    """What the stage `demonstrations` is told."""

    domain: str
    seed: Seed
    count: Count


class TrajectoryModel(Model):
    """A variational autoencoder over motions."""

    latent: Annotated[int, Field(ge=1, le=100)] = Field(description="dimension of a latent")
    hidden: Widths = Field(description="widths of hidden layers")
    steps: Steps = Field(description="of the optimiser")
    batch: Annotated[int, Field(ge=1, le=1_000_000)] = Field(description="demonstrations of a step")
    learning_rate: LearningRate = Field(description="of Adam")
    noise: Annotated[float, Field(gt=0, le=10)] = Field(
        description="sd of the decoder, in the unit of waypoints"
    )


class TrajectoryModelSettings(TrajectoryModel):
    """What the stage `trajectory_model` is told."""

    seed: Seed
    duration_s: Duration


class Splits(Model):
    """How many of something each of the three splits has."""

    train: Count = Field(description="how many for training")
    validation: Count = Field(description="how many for calibration")
    test: Count = Field(description="how many for evaluation")

    def count(self, split: str) -> int:
        """Of the split of that name."""
        return {"train": self.train, "validation": self.validation, "test": self.test}[split]


class Swings(Splits):
    """Sampled latents, each executed once, of the three splits."""


class SwingsSettings(Swings):
    """What the stage `swings` is told."""

    domain: str
    seed: Seed
