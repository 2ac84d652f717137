"""Block `retraining` of a domain: retraining of a method with the findings of a diagnosis."""

from typing import Annotated, Literal

from pydantic import Field

from slapshot.config.rollouts import DrawnRollouts
from slapshot.config.sources import RecordedSettings
from slapshot.config.values import Few, Hits, Name, Seed
from slapshot.validation import Model

_Margin = Annotated[float, Field(gt=0, le=10)]


class Retraining(Model):
    """Retraining of a method with the findings of a diagnosis of a recording."""

    recording: Name = Field(description="name of one of the domain's recordings")
    method: Name = Field(description="name of one of the domain's methods")
    margin: _Margin = Field(description="share by which ranges extend beyond fitted values")
    samples: Hits = Field(description="largest number of hits to adapt to")
    repeats: Few = Field(description="random splits")


class ArmRolloutsSettings(DrawnRollouts):
    """Settings of the stage `arm_rollouts`."""

    arm: Literal["refitted", "augmented"]
    margin: _Margin
    effects: list[str]


class HeldOutSettings(RecordedSettings):
    """Settings of the stage `held_out`."""


class ArmsSettings(RecordedSettings):
    """Settings of the stage `arms`."""

    domain: Name
    seed: Seed
    samples: Hits
