"""The whole configuration."""

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from slapshot.config.calibration import Calibration
from slapshot.config.cases import Cases
from slapshot.config.domain import Domain
from slapshot.config.lab import Lab
from slapshot.config.layers import merge
from slapshot.config.regression import Regression
from slapshot.config.values import Name
from slapshot.validation import Model, ProblemAtError, validated_part, values_of

# Folders to which the default configuration publishes, in addition to its figures.
_TAKEN = ("proof", "proof-joints", "small-proof", "fresh", "nulls", "joint-coverage")
_TAKEN_BEGINNING = "circle-"


class Configuration(Model):
    """A configuration of slapshot."""

    name: Name = Field(description="default publishes to figures/, any other name to figures/<name>/")
    regression: Regression = Field(description="the paper's walkthrough")
    proof: Literal["published", "fresh"] = Field(description="cases of `snakemake proof`")
    cases: Cases = Field(description="cases with hidden effects, for the blind validation of the diagnosis")
    calibration: Calibration = Field(description="of p-values and intervals in the diagnosis of joints")
    domains: Annotated[dict[Name, Domain], Field(min_length=1, max_length=100)] = Field(
        description="name -> domain"
    )

    @field_validator("name")
    @classmethod
    def _publishes_apart(cls, name: str) -> str:
        if name in _TAKEN or name.startswith(_TAKEN_BEGINNING):
            raise ProblemAtError(
                (), f"figures/{name} is a folder of the default configuration; write another name"
            )
        return name

    @model_validator(mode="after")
    def _cases_can_be_made(self) -> "Configuration":
        cases = self.cases
        if cases.domain not in self.domains:
            known = ", ".join(self.domains)
            raise ProblemAtError(("cases", "domain"), f"no domain {cases.domain!r}; use one of: {known}")
        domain = self.domains[cases.domain]
        if not domain.stand_ins:
            return self  # without recordings no cases can be made
        if cases.like not in domain.stand_ins:
            raise ProblemAtError(
                ("cases", "like"),
                f"{cases.like!r} is no recording of stand-in rigs of domains.{cases.domain}; use one of: "
                f"{', '.join(domain.stand_ins)}",
            )
        _ = self.lab_of_cases
        return self

    @property
    def lab_of_cases(self) -> Lab:
        """Block `lab` of all cases: that of the recording `cases.like`, overridden by `cases.lab`.

        Raises:
            ProblemAtError: the combination is not valid.
        """
        lab = self.domains[self.cases.domain].stand_ins[self.cases.like].lab
        together = merge(values_of(lab), self.cases.lab)
        return validated_part(Lab, together, ("cases", "lab"))
