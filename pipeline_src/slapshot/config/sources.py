"""What stages are told of recordings: where they come from, and which model their latents are of."""

from typing import Annotated

from pydantic import Field

from slapshot.config.values import FilePath, MayMiss
from slapshot.validation import Model


class Source(Model):
    """Where a recording comes from: from stand-in rigs, or from a folder of one's own."""

    rigs: MayMiss[Annotated[int, Field(ge=1)]] = Field(default=None, description="how many stand-in rigs")
    path: MayMiss[FilePath] = Field(default=None, description="the folder")


class RecordedSettings(Model):
    """What every stage is told that reads recordings."""

    recordings: dict[str, Source]


class RecordedTasksSettings(RecordedSettings):
    """What every stage is told that puts recordings before a trained method."""

    trajectory_model_id: str
