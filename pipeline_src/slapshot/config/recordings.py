"""Recordings that a domain has, and blocks that build on one of them."""

from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.lab import Lab
from slapshot.config.values import Few, FilePath, MayMiss, Name, Several
from slapshot.validation import Model, ProblemAtError

_Hits = Annotated[int, Field(ge=1, le=10_000)]


class Recording(Model):
    """Hits of stand-in rigs, or of a rig of one's own."""

    path: MayMiss[FilePath] = Field(None, description="folder of a recording of one's own")
    samples: _Hits = Field(description="hits to adapt to")
    repeats: Few = Field(description="random splits of the hits")
    rigs: MayMiss[Few] = Field(None, description="how many stand-in rigs are drawn")
    lab: MayMiss[Lab] = Field(None, description="settings of stand-in rigs")

    @model_validator(mode="after")
    def _one_origin(self) -> "Recording":
        given = [key for key in ("lab", "path") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(f"has {' and '.join(given) or 'none'} of lab, path; give exactly one of them")
        if self.lab is not None and self.rigs is None:
            raise ValueError("key 'rigs' is missing; add it (how many stand-in rigs are drawn)")
        if self.lab is None and self.rigs is not None:
            raise ProblemAtError(("rigs",), "a recording of one's own is of one rig; remove the key")
        if self.lab is not None and self.samples >= self.lab.hits:
            raise ProblemAtError(
                ("samples",),
                f"{self.samples} hits to adapt to leave none of lab.hits = {self.lab.hits} to predict; lower "
                "the first or raise the second",
            )
        return self


class Retraining(Model):
    """A method trained again on what a diagnosis of a recording found."""

    recording: Name = Field(description="name of one of the domain's recordings")
    method: Name = Field(description="name of one of the domain's methods")
    margin: Annotated[float, Field(gt=0, le=10)] = Field(
        description="share by which ranges go beyond fitted values"
    )
    samples: _Hits = Field(description="hits to adapt to, at most")
    repeats: Few = Field(description="random splits")


class Refinement(Model):
    """Ranges of randomisation from beliefs about a recording."""

    recording: Name = Field(description="name of one of the domain's recordings")
    method: Name = Field(description="name of one of the domain's methods")
    # What errors of the first few predictions tell is ignorance, and no noise.
    samples: Annotated[int, Field(ge=5, le=10_000)] = Field(description="hits that a belief is about")
    repeats: Few = Field(description="random choices of them")
    nearest: Annotated[int, Field(ge=32, le=1_000_000)] = Field(
        description="simulated conditions that a range is made from"
    )
    retrained: Several[Annotated[int, Field(ge=0, le=999)]] = Field(
        description="rigs whose rollouts and models are made again; stand-ins alone, for they are hit anew"
    )
    queries: _Hits = Field(description="new hits to predict, of each object")
