"""Refined configurations, as later stages read them."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from slapshot.config.randomisation import Draws
from slapshot.config.values import Variance
from slapshot.validation import Model, validated
from slapshot.yaml_file import read_document


class RefinedRange(Model):
    """Of one parameter."""

    uniform: Annotated[list[float], Field(min_length=2, max_length=2)]


class RefinedTraining(Model):
    """What noise a model is trained with."""

    noise_variance_max: Variance


class RefinedDomain(Model):
    """What a refined configuration says of a domain."""

    randomisation: dict[str, RefinedRange]
    training: RefinedTraining


class RefinedConfiguration(Model):
    """A configuration that the stage `refinement` wrote."""

    name: str
    domains: dict[str, RefinedDomain]


def refined_settings(refinement: Path, domain: str, rig: int) -> RefinedDomain:
    """Settings of a domain in rig-<rig>.yaml."""
    document = read_document(refinement / f"rig-{rig}.yaml")
    return validated(RefinedConfiguration, document.values, document.where).domains[domain]


def narrowed(randomisation: Draws, refined: RefinedDomain) -> Draws:
    """The randomisation with refined ranges where there are any; other parameters keep their range."""
    changed = {
        name: randomisation.of_parameter(name).within(*found.uniform)
        for name, found in refined.randomisation.items()
    }
    return Draws.from_parts(randomisation, **changed)
