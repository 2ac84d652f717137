"""Block `cases`: concealed cases, on which the diagnosis is proven, and what its stages are told."""

from typing import Annotated, Any, Literal

from pydantic import Field

from slapshot.config.lab import Lab
from slapshot.config.sources import RecordedSettings
from slapshot.config.trajectories import Pool
from slapshot.config.values import Count, Duration, FilePath, Name, Rate, Seed
from slapshot.validation import Model


class Cases(Model):
    """Concealed cases, on which the diagnosis is proven."""

    domain: Name = Field(description="whose scene the rigs have")
    published: FilePath = Field(description="list of the cases of the full proof (CSV)")
    small: FilePath = Field(description="list of those of the small one")
    joints: FilePath = Field(description="list of those of the proof for joints")
    seed: Seed = Field(description="of the pool of commands")
    pool: Pool = Field(description="demonstrations that commands are drawn from")
    like: Name = Field(description="recording of the domain whose rigs these are like")
    lab: dict[str, Any] = Field(description="keys of its block `lab` that differ")


class NominalSettings(Model):
    """What a diagnosis of hits is told beside the scene."""

    friction: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        description="nominal mu_x, mu_y, and torsional friction in m"
    )
    effects: list[str] = Field(description="modules with effects of one's own")


class DiagnosisSettings(NominalSettings, RecordedSettings):
    """What the stages `diagnosis` and `findings` are told."""

    seed: Seed


class SignaturesSettings(Model):
    """What the stage `signatures` is told."""

    effects: list[str]
    count: Count
    duration_s: Duration
    rate_hz: Rate


class VerdictSettings(NominalSettings):
    """What the stage `verdict` is told."""

    seed: Seed


class ProofSettings(Model):
    """What a proof tells of how it was made."""

    list: Literal["small", "full"]
    pool: Pool
    lab: Lab


class ScoreSettings(ProofSettings, NominalSettings):
    """What the stage `score` is told; cases by name, with their condition."""

    cases: dict[str, str]
    diagnosis_seed: Seed


class JointVerdictSettings(Model):
    """What the stage `joint_verdict` is told."""

    seed: Seed


class JointScoreSettings(Model):
    """What the stage `joint_score` is told: cases by name, with their condition."""

    cases: dict[str, str]
