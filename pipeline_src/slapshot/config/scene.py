"""Blocks `scene` and `randomisation` of a domain: what moves, and what is drawn for every condition."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag, field_validator, model_validator

from slapshot.config.values import (
    Coefficient,
    Coordinate,
    Interval,
    Label,
    Mass,
    MayMiss,
    Point,
    Text,
)
from slapshot.domains.fetchslide import settings as fetchslide
from slapshot.domains.hockey import settings as hockey
from slapshot.scenes.randomisation import CONDITION_PARAMETERS
from slapshot.scenes.settings import SceneSettings, Timestep
from slapshot.validation import Model, ProblemAtError

_SAFE_SPREADS = 5  # a normal draw is taken to stay within so many standard deviations


class HockeyScene(hockey.HockeyScene):
    """A puck on a whiteboard, and an arm with a stick."""

    joints: ClassVar[int] = 7
    domain: Literal["hockey"] = Field(description="built in")


class FetchslideScene(fetchslide.FetchSlideScene):
    """The environment of gymnasium-robotics as it is."""

    joints: ClassVar[None] = None  # of scripted commands alone; no stand-in rig has been made of it
    domain: Literal["fetchslide"] = Field(description="built in")


class OwnScene(SceneSettings):
    """A domain of one's own, whose module knows what else there is."""

    model_config = ConfigDict(extra="allow")

    joints: ClassVar[None] = None  # only its module knows
    timestep_s: MayMiss[Timestep] = Field(None, description="s; divides 1 ms")
    start_m: MayMiss[Point] = Field(None, description="x and y, where the object is meant to lie")

    @field_validator("domain")
    @classmethod
    def _strikes(cls, domain: str) -> str:
        if domain == "table":
            raise ValueError(
                "nothing strikes the box of a 'table'; name hockey or fetchslide, or diagnose recordings of "
                "a table with a rig file"
            )
        return domain


def _scene_of(scene: Any) -> str:
    domain = scene.get("domain") if isinstance(scene, dict) else getattr(scene, "domain", None)
    return domain if isinstance(domain, str) and domain in {"hockey", "fetchslide"} else "own"


Scene = Annotated[
    Annotated[HockeyScene, Tag("hockey")]
    | Annotated[FetchslideScene, Tag("fetchslide")]
    | Annotated[OwnScene, Tag("own")],
    Discriminator(_scene_of),
]


class Distribution(Model):
    """What a parameter is drawn from."""

    nonnegative: ClassVar[bool] = True
    normal: MayMiss[Annotated[list[Coordinate], Field(min_length=2, max_length=2)]] = Field(
        None, description="[mean, standard deviation]"
    )
    times: MayMiss[Text] = Field(None, description="another parameter that scales the draw")
    label: Label = Field(description="for pictures")
    unit: Label = Field(description="for pictures")

    @model_validator(mode="after")
    def _one_shape(self) -> "Distribution":
        given = [key for key in ("uniform", "normal") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(
                f"has {' and '.join(given) or 'none'} of uniform, normal; give exactly one of them"
            )
        if self.normal is not None:
            mean, spread = self.normal
            if spread < 0:
                raise ProblemAtError(
                    ("normal",), f"standard deviation {spread} is negative; write [mean, sd] with sd >= 0"
                )
            if self.nonnegative and mean - _SAFE_SPREADS * spread <= 0:
                raise ProblemAtError(
                    ("normal",),
                    f"{self.normal} draws values below 0, which this parameter cannot have; write a mean "
                    f"above {_SAFE_SPREADS} standard deviations, or use uniform",
                )
        return self


class MassDistribution(Distribution):
    """Of what weighs something."""

    uniform: MayMiss[Interval[Mass]] = Field(None, description="[low, high]")


class FrictionDistribution(Distribution):
    """Of what may be 0, but not for all conditions: an object without friction never rests."""

    uniform: MayMiss[Interval[Coefficient]] = Field(None, description="[low, high]")


class StartErrorDistribution(Distribution):
    """Of what may be negative."""

    nonnegative: ClassVar[bool] = False
    uniform: MayMiss[Interval[Coordinate]] = Field(None, description="[low, high]")


class Randomisation(Model):
    """What conditions, and starts, are drawn from."""

    mass: MassDistribution = Field(description="kg")
    friction_x: FrictionDistribution = Field(description="of object and plane, along x")
    friction_y: FrictionDistribution = Field(description="along y")
    friction_torsional: FrictionDistribution = Field(description="m")
    friction_rolling: FrictionDistribution = Field(description="m")
    start_error: StartErrorDistribution = Field(description="m, along x and along y, anew for every hit")

    @model_validator(mode="after")
    def _in_order(self) -> "Randomisation":
        for parameter in type(self).model_fields:
            spec: Distribution = getattr(self, parameter)
            drawn = CONDITION_PARAMETERS
            earlier = drawn[: drawn.index(parameter)] if parameter in drawn else ()
            if spec.times is not None and spec.times not in earlier:
                advice = f"use one of: {', '.join(earlier)}" if earlier else "leave `times` out"
                raise ProblemAtError(
                    (parameter, "times"), f"no parameter {spec.times!r} is drawn before {parameter}; {advice}"
                )
        for parameter in ("friction_x", "friction_y"):
            if getattr(self, parameter).uniform == [0, 0]:
                raise ProblemAtError(
                    (parameter, "uniform"),
                    "[0, 0] is no friction, so that nothing comes to rest; write a high > 0",
                )
        return self
