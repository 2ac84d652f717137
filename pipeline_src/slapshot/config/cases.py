"""Block `cases`: blind validation of the diagnosis on rigs with hidden effects; settings of its stages."""

from typing import Annotated, Any, Literal

from pydantic import Field

from slapshot.config.lab import Lab
from slapshot.config.sources import RecordedSettings
from slapshot.config.trajectories import Pool
from slapshot.config.values import Count, Duration, FilePath, Name, Rate, Seed
from slapshot.validation import Model


class Cases(Model):
    """Cases with hidden effects, for the blind validation of the diagnosis."""

    domain: Name = Field(description="domain with the scene of the rigs")
    published: FilePath = Field(description="list of the cases of the full validation (CSV)")
    small: FilePath = Field(description="list of the cases of the small validation (CSV)")
    joints: FilePath = Field(description="list of the cases of the validation for joints (CSV)")
    seed: Seed = Field(description="of the pool of commands")
    pool: Pool = Field(description="demonstrations that commands are drawn from")
    like: Name = Field(description="recording of the domain whose block `lab` is the base for the rigs")
    lab: dict[str, Any] = Field(description="keys of that block `lab` to override")


class NominalSettings(Model):
    """Settings of a diagnosis of hits, in addition to the scene."""

    friction: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="nominal mu_x, mu_y, and torsional friction in m"
    )
    effects: list[str] = Field(description="modules with user-defined effects")


class DiagnosisSettings(NominalSettings, RecordedSettings):
    """Settings of the stages `diagnosis` and `findings`."""

    seed: Seed


class SignaturesSettings(Model):
    """Settings of the stage `signatures`."""

    effects: list[str]
    count: Count
    duration_s: Duration
    rate_hz: Rate


class VerdictSettings(NominalSettings):
    """Settings of the stage `verdict`."""

    seed: Seed


class ProofSettings(Model):
    """Provenance of a blind validation."""

    list: Literal["small", "full"]
    pool: Pool
    lab: Lab


class ScoreSettings(ProofSettings, NominalSettings):
    """Settings of the stage `score`; `cases` is name -> condition."""

    cases: dict[str, str]
    diagnosis_seed: Seed


class JointVerdictSettings(Model):
    """Settings of the stage `joint_verdict`."""

    seed: Seed


class JointScoreSettings(Model):
    """Settings of the stage `joint_score`; `cases` is name -> condition."""

    cases: dict[str, str]
