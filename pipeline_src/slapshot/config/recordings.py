"""Block `recordings` of a domain: hits of stand-in rigs or of the user's own rig."""

from pydantic import Field, model_validator

from slapshot.config.lab import Lab
from slapshot.config.values import Few, FilePath, Hits, MayMiss
from slapshot.validation import Model, ProblemAtError


class Recording(Model):
    """Hits of stand-in rigs, or of the user's own rig."""

    path: MayMiss[FilePath] = Field(default=None, description="folder of the user's own recording")
    samples: Hits = Field(description="hits to adapt to")
    repeats: Few = Field(description="random splits of the hits")
    rigs: MayMiss[Few] = Field(default=None, description="number of stand-in rigs")
    lab: MayMiss[Lab] = Field(default=None, description="settings of stand-in rigs")

    @model_validator(mode="after")
    def _one_origin(self) -> "Recording":
        given = [key for key in ("lab", "path") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ProblemAtError(
                (), f"has {' and '.join(given) or 'none'} of lab, path; give exactly one of them"
            )
        if self.lab is not None and self.rigs is None:
            raise ProblemAtError((), "key 'rigs' is missing; add it (how many stand-in rigs are drawn)")
        if self.lab is None and self.rigs is not None:
            raise ProblemAtError(("rigs",), "a recording of one's own is of one rig; remove the key")
        if self.lab is not None and self.samples >= self.lab.hits:
            raise ProblemAtError(
                ("samples",),
                f"{self.samples} hits to adapt to leave none of lab.hits = {self.lab.hits} to predict; lower "
                "the first or raise the second",
            )
        return self


class StandInRecording(Recording):
    """Hits of stand-in rigs."""

    rigs: Few = Field(description="number of stand-in rigs")
    lab: Lab = Field(description="settings of stand-in rigs")
