"""Block `refinement` of a domain: refines the randomisation's ranges from beliefs about a recording."""

from typing import Annotated

from pydantic import Field

from slapshot.config.acting import RobotSettings
from slapshot.config.methods import TrainSettings
from slapshot.config.randomisation import Draws
from slapshot.config.rollouts import RolloutsSettings
from slapshot.config.sources import RecordedTasksSettings
from slapshot.config.values import Few, Hits, Name, Seed, Several, Variance
from slapshot.validation import Model

# At least five: errors of the first few predictions are dominated by ignorance of the parameters, not by
# noise.
_Samples = Annotated[int, Field(ge=5, le=10_000)]
_Rig = Annotated[int, Field(ge=0, le=999)]


class Believed(Model):
    """Data from which a range is computed."""

    samples: _Samples = Field(description="hits that a belief is inferred from")
    repeats: Few = Field(description="random choices of these hits")
    nearest: Annotated[int, Field(ge=32, le=1_000_000)] = Field(
        description="number of nearest simulated conditions, from which a range is computed"
    )


class Refinement(Believed):
    """Refinement of the randomisation's ranges from beliefs about a recording."""

    recording: Name = Field(description="name of one of the domain's recordings")
    method: Name = Field(description="name of one of the domain's methods")
    retrained: Several[_Rig] = Field(
        description="stand-in rigs for which rollouts and models are recomputed and new hits are executed"
    )
    queries: Hits = Field(description="new hits to predict, of each object")


class RefinementSettings(Believed, RecordedTasksSettings):
    """Settings of the stage `refinement`."""

    domain: Name
    method: Name
    seed: Seed
    randomisation: Draws
    noise_variance_max: Variance


class RefinedRolloutsSettings(RolloutsSettings):
    """Settings of the stage `refined_rollouts`; `name` is the domain's name in the configuration."""

    name: Name
    rig: _Rig


class RefinedTrainSettings(TrainSettings):
    """Settings of the stage `refined_train`; `name` is the domain's name in the configuration."""

    name: Name
    rig: _Rig


class RefinedErrorsSettings(RobotSettings):
    """Settings of the stage `refined_errors`."""

    samples: _Samples
    repeats: Few
    queries: Hits
