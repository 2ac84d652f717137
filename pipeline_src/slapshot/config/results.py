"""What people look at: block `viewer` of a domain, and what figures, claims and the viewer are told."""

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

    simulated: Annotated[int, Field(ge=0, le=1_000_000)] = Field(description="hits to show, at most")
    recorded: Annotated[int, Field(ge=0, le=1_000_000)] = Field(description="hits to show, at most")


class ViewerSettings(Viewer, RecordedSettings):
    """What the stage `viewer` is told."""

    domain: Name


class ClaimSettings(Model):
    """What the stage `claim` is told: the claim's module, and the domain's name in the configuration."""

    module: str
    domain: Name


class AnyFigureSettings(Model):
    """Which module draws a figure; what else there is, that module knows."""

    model_config = ConfigDict(extra="ignore")

    module: str


class FigureSettings(Model):
    """What the stage `figure` is told: the figure's module, and the domain's name in the configuration."""

    module: str
    domain: Name


class PolicyFigureSettings(FigureSettings):
    """Of a figure that compares policies with a method."""

    method: Name


class LatentsFigureSettings(FigureSettings):
    """Of a figure of hidden states: the methods that it shows."""

    methods: list[Name]


class Sizes(Model):
    """Dimensions of state, action and outcome."""

    state: int
    action: int
    outcome: int


class MethodFigureSettings(FigureSettings):
    """Of a figure of the method as it is built."""

    kalman: KalmanSettings
    sizes: Sizes


class SetupFigureSettings(FigureSettings):
    """Of a figure of the scene."""

    scene: Scene


class RandomisationFigureSettings(FigureSettings):
    """Of a table of what is drawn."""

    figure: Literal["T1", "T2"]
    randomisation: Randomisation
