"""Settings of stages about recordings: their source, and the model that their latents belong to."""

from typing import Annotated

from pydantic import Field

from slapshot.config.values import FilePath, MayMiss
from slapshot.validation import Model


class Source(Model):
    """Source of a recording: stand-in rigs, or a user's own folder."""

    rigs: MayMiss[Annotated[int, Field(ge=1)]] = Field(default=None, description="number of stand-in rigs")
    path: MayMiss[FilePath] = Field(default=None, description="the user's own folder")


class RecordedSettings(Model):
    """Settings of every stage that reads recordings."""

    recordings: dict[str, Source]


class RecordedTasksSettings(RecordedSettings):
    """Settings of every stage that applies a trained method to recordings."""

    trajectory_model_id: str
