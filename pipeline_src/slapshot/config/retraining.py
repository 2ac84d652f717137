"""Block `retraining` of a domain: a method trained again on what a diagnosis of a recording found."""

from typing import Annotated, Literal

from pydantic import Field

from slapshot.config.rollouts import DrawnRollouts
from slapshot.config.sources import RecordedSettings
from slapshot.config.values import Few, Hits, Name, Seed
from slapshot.validation import Model

_Margin = Annotated[float, Field(gt=0, le=10)]


class Retraining(Model):
    """A method trained again on what a diagnosis of a recording found."""

    recording: Name = Field(description="name of one of the domain's recordings")
    method: Name = Field(description="name of one of the domain's methods")
    margin: _Margin = Field(description="share by which ranges go beyond fitted values")
    samples: Hits = Field(description="hits to adapt to, at most")
    repeats: Few = Field(description="random splits")


class ArmRolloutsSettings(DrawnRollouts):
    """What the stage `arm_rollouts` is told."""

    arm: Literal["refitted", "augmented"]
    margin: _Margin
    effects: list[str]


class HeldOutSettings(RecordedSettings):
    """What the stage `held_out` is told."""


class ArmsSettings(RecordedSettings):
    """What the stage `arms` is told."""

    domain: Name
    seed: Seed
    samples: Hits
