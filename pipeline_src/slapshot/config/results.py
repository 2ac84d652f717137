"""Results: block `viewer` of a domain, and the settings of figures, claims and the viewer."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from slapshot.config.methods import KalmanSettings
from slapshot.config.randomisation import Randomisation
from slapshot.config.scene import Scene
from slapshot.config.sources import RecordedSettings
from slapshot.config.values import Name
from slapshot.validation import Model


class Viewer(Model):
    """Rerun recordings."""

    simulated: Annotated[int, Field(ge=0, le=1_000_000)] = Field(description="largest number of hits to show")
    recorded: Annotated[int, Field(ge=0, le=1_000_000)] = Field(description="largest number of hits to show")


class ViewerSettings(Viewer, RecordedSettings):
    """Settings of the stage `viewer`."""

    domain: Name


class ClaimSettings(Model):
    """Settings of the stage `claim`: the claim's module, and the domain's name in the configuration."""

    module: str
    domain: Name


class AnyFigureSettings(Model):
    """The module that draws a figure; that module validates all other settings."""

    model_config = ConfigDict(extra="ignore")

    module: str


class FigureSettings(Model):
    """Settings of the stage `figure`: the figure's module, and the domain's name in the configuration."""

    module: str
    domain: Name


class PolicyFigureSettings(FigureSettings):
    """Settings of a figure that compares policies with a method."""

    method: Name


class LatentsFigureSettings(FigureSettings):
    """Settings of a figure of hidden states: the methods that it shows."""

    methods: list[Name]


class Sizes(Model):
    """Dimensions of state, action and outcome."""

    state: int
    action: int
    outcome: int


class MethodFigureSettings(FigureSettings):
    """Settings of a figure of the method's architecture."""

    kalman: KalmanSettings
    sizes: Sizes


class SetupFigureSettings(FigureSettings):
    """Settings of a figure of the scene."""

    scene: Scene


class RandomisationFigureSettings(FigureSettings):
    """Settings of a table of the randomisation."""

    figure: Literal["T1", "T2"]
    randomisation: Randomisation
