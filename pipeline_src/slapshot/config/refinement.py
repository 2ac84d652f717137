"""Block `refinement` of a domain: ranges of randomisation from beliefs about a recording."""

from typing import Annotated

from pydantic import Field

from slapshot.config.acting import RobotSettings
from slapshot.config.methods import TrainSettings
from slapshot.config.randomisation import Draws
from slapshot.config.rollouts import RolloutsSettings
from slapshot.config.sources import RecordedTasksSettings
from slapshot.config.values import Few, Hits, Name, Seed, Several, Variance
from slapshot.validation import Model

# What errors of the first few predictions tell is ignorance, and no noise.
_Samples = Annotated[int, Field(ge=5, le=10_000)]
_Rig = Annotated[int, Field(ge=0, le=999)]


class Believed(Model):
    """What a range is made from."""

    samples: _Samples = Field(description="hits that a belief is about")
    repeats: Few = Field(description="random choices of them")
    nearest: Annotated[int, Field(ge=32, le=1_000_000)] = Field(
        description="simulated conditions that a range is made from"
    )


class Refinement(Believed):
    """Ranges of randomisation from beliefs about a recording."""

    recording: Name = Field(description="name of one of the domain's recordings")
    method: Name = Field(description="name of one of the domain's methods")
    retrained: Several[_Rig] = Field(
        description="rigs whose rollouts and models are made again; stand-ins alone, for they are hit anew"
    )
    queries: Hits = Field(description="new hits to predict, of each object")


class RefinementSettings(Believed, RecordedTasksSettings):
    """What the stage `refinement` is told."""

    domain: Name
    method: Name
    seed: Seed
    randomisation: Draws
    noise_variance_max: Variance


class RefinedRolloutsSettings(RolloutsSettings):
    """What the stage `refined_rollouts` is told; `name` is the domain's in the configuration."""

    name: Name
    rig: _Rig


class RefinedTrainSettings(TrainSettings):
    """What the stage `refined_train` is told; `name` is the domain's in the configuration."""

    name: Name
    rig: _Rig


class RefinedErrorsSettings(RobotSettings):
    """What the stage `refined_errors` is told."""

    samples: _Samples
    repeats: Few
    queries: Hits
