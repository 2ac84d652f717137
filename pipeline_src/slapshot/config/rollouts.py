"""Block `rollouts` of a domain: simulated hits."""

from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.randomisation import Draws
from slapshot.config.scene import CONTROL_PERIOD
from slapshot.config.trajectories import Splits
from slapshot.config.values import Count, Mass, MayMiss, PositiveCoefficient, Seed, Title
from slapshot.validation import Model, ProblemAtError

_MOST_HITS = 1_000_000_000  # of a domain; they take 600 hours on one core


class NamedCondition(Model):
    """Parameters of a condition; a missing one takes the mean of its distribution."""

    mass: MayMiss[Mass] = Field(default=None, description="kg")
    friction_x: MayMiss[PositiveCoefficient] = Field(default=None, description="along x")
    friction_y: MayMiss[PositiveCoefficient] = Field(default=None, description="along y")
    friction_torsional: MayMiss[PositiveCoefficient] = Field(default=None, description="m")
    friction_rolling: MayMiss[PositiveCoefficient] = Field(default=None, description="m")

    @property
    def given(self) -> dict[str, float]:
        """Parameter -> value of the parameters that are given."""
        return self.model_dump(exclude_unset=True)


class Rollouts(Splits):
    """Simulated hits."""

    train: Count = Field(description="conditions for training")
    validation: Count = Field(description="conditions for calibration")
    test: Count = Field(description="conditions for evaluation, in addition to the named ones")
    hits: Annotated[int, Field(ge=1, le=100_000)] = Field(description="of each condition")
    # Greater than 0, because figures show tracks.
    track_share: Annotated[float, Field(gt=0, le=1)] = Field(description="share of hits with a stored track")
    track_period_s: Annotated[float, Field(ge=CONTROL_PERIOD, le=10)] = Field(
        description="sampling period of tracks"
    )
    named_conditions: Annotated[dict[Title, NamedCondition], Field(max_length=100)] = Field(
        description="test conditions that figures refer to by name"
    )

    @property
    def conditions(self) -> int:
        """Number of conditions of all splits together."""
        return self.train + self.validation + self.test + len(self.named_conditions)

    @model_validator(mode="after")
    def _end_some_day(self) -> "Rollouts":
        hits = self.conditions * self.hits
        if hits > _MOST_HITS:
            raise ProblemAtError((), f"{hits:,} hits are more than {_MOST_HITS:,}; lower train or hits")
        return self


class DrawnRollouts(Rollouts):
    """Rollouts with everything that determines their conditions and hits."""

    seed: Seed
    randomisation: Draws


class RolloutsSettings(DrawnRollouts):
    """Settings of the stage `rollouts`."""

    domain: str
