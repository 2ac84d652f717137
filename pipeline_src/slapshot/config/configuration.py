"""The whole configuration."""

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from slapshot.config.calibration import Calibration
from slapshot.config.domain import Domain
from slapshot.config.lab import Lab, ScriptedHits
from slapshot.config.layers import merge
from slapshot.config.regression import Regression
from slapshot.config.values import Box, FilePath, MayMiss, Name, Seed
from slapshot.validation import Model, ProblemAtError, validated_part

# Folders that the default configuration publishes to, beside its figures.
_TAKEN = ("proof", "proof-joints", "small-proof", "fresh", "nulls", "joint-coverage")
_TAKEN_BEGINNING = "circle-"


class Pool(ScriptedHits):
    """Demonstrations that commands are drawn from."""

    count: Annotated[int, Field(ge=1, le=100_000)] = Field(description="how many")
    place_m: MayMiss[Box] = Field(
        None,
        description="where the object lies, of a domain in which that differs: lowest and highest x, then y",
    )


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


class Configuration(Model):
    """A configuration of slapshot."""

    name: Name = Field(description="default publishes to figures/, any other name to figures/<name>/")
    regression: Regression = Field(description="the paper's walkthrough")
    proof: Literal["published", "fresh"] = Field(description="cases of `snakemake proof`")
    cases: Cases = Field(description="concealed cases, on which the diagnosis is proven")
    calibration: Calibration = Field(description="of p-values and intervals of joints")
    domains: Annotated[dict[Name, Domain], Field(min_length=1, max_length=100)] = Field(
        description="name -> domain"
    )

    @field_validator("name")
    @classmethod
    def _publishes_apart(cls, name: str) -> str:
        if name in _TAKEN or name.startswith(_TAKEN_BEGINNING):
            raise ValueError(f"figures/{name} is a folder of the default configuration; write another name")
        return name

    @model_validator(mode="after")
    def _cases_can_be_made(self) -> "Configuration":
        cases = self.cases
        if cases.domain not in self.domains:
            known = ", ".join(self.domains)
            raise ProblemAtError(("cases", "domain"), f"no domain {cases.domain!r}; use one of: {known}")
        domain = self.domains[cases.domain]
        if not domain.stand_ins:
            return self  # there is nothing to conceal anything on, and no cases are made
        if cases.like not in domain.stand_ins:
            raise ProblemAtError(
                ("cases", "like"),
                f"{cases.like!r} is no recording of stand-in rigs of domains.{cases.domain}; use one of: "
                f"{', '.join(domain.stand_ins)}",
            )
        lab = domain.recordings[cases.like].lab
        assert lab is not None
        together = merge(lab.model_dump(exclude_unset=True), cases.lab)
        validated_part(Lab, together, ("cases", "lab"))
        return self
