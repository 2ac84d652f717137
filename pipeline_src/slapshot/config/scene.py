"""Block `scene` of a domain: what moves."""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag, field_validator

from slapshot.config.values import MayMiss, Point
from slapshot.own_code import MODULE
from slapshot.validation import Model, ProblemAtError

CONTROL_PERIOD = 0.001  # s; commands are sent at whole steps of integration


def _divides_control_period(timestep: float) -> float:
    steps = CONTROL_PERIOD / timestep
    if abs(steps - round(steps)) > 1e-9 * steps:
        raise ProblemAtError(
            (),
            f"{timestep} does not divide {CONTROL_PERIOD} s; use 0.001, 0.0005, 0.00025 or another whole "
            "part",
        )
    return timestep


# Contacts have a time constant of 5 ms, which a step must resolve: above 1 ms rest points move by
# centimetres. Below 10 microseconds they no longer change, and a hit of 2 s takes more than 200,000 steps.
Timestep = Annotated[
    float,
    Field(ge=1e-5, le=CONTROL_PERIOD, description="step of integration in s; divides 1 ms"),
    AfterValidator(_divides_control_period),
]
# What a camera sees: a laboratory is no larger.
Coordinate = Annotated[float, Field(ge=-100, le=100, description="m")]
Extent = Annotated[float, Field(ge=0.01, le=100, description="m, of a surface")]

PuckName = Literal["inline", "ice"]

# From axis 1 to the middle of the blade of an arm that lies flat: links of 0.4 and 0.39 m, 0.078 m to the
# flange, 0.5 m of stick. The arm's own foot takes 0.15 m.
NEAREST, FARTHEST = 0.15, 1.37  # m


def _within_reach(start: tuple[float, float]) -> tuple[float, float]:
    distance = math.hypot(*start)
    if not NEAREST <= distance <= FARTHEST:
        raise ProblemAtError(
            (),
            f"{list(start)} is {distance:g} m from the robot's axis 1; put the puck within reach of the "
            f"stick, {NEAREST:g} to {FARTHEST:g} m from it",
        )
    return start


class SceneSettings(Model):
    """Base of the block `scene` of a domain."""

    domain: str = Field(
        pattern=MODULE,
        max_length=200,
        description="folder of slapshot.domains, or dotted name of a module of one's own",
    )


class HockeySettings(SceneSettings):
    """A puck before an arm with a stick, in hockey or in a domain of one's own that builds on it."""

    puck: PuckName = Field(description="which puck one buys")
    timestep_s: Timestep
    start_m: Annotated[tuple[Coordinate, Coordinate], AfterValidator(_within_reach)] = Field(
        description="x, y in m where the puck is meant to lie"
    )
    board_m: tuple[Extent, Extent] = Field(description="x, y in m of the whiteboard that one sees")


class HockeyScene(HockeySettings):
    """A puck on a whiteboard, and an arm with a stick."""

    joints: ClassVar[int] = 7
    domain: Literal["hockey"] = Field(description="built in")


class FetchslideScene(SceneSettings):
    """The environment of gymnasium-robotics as it is."""

    joints: ClassVar[None] = None  # of scripted commands alone; no stand-in rig has been made of it
    domain: Literal["fetchslide"] = Field(description="built in")


class OwnScene(SceneSettings):
    """A domain of one's own, whose module knows what else there is."""

    model_config = ConfigDict(extra="allow")

    joints: ClassVar[None] = None  # only its module knows
    timestep_s: MayMiss[Timestep] = Field(default=None, description="s; divides 1 ms")
    start_m: MayMiss[Point] = Field(default=None, description="x and y, where the object is meant to lie")

    @field_validator("domain")
    @classmethod
    def _strikes(cls, domain: str) -> str:
        if domain == "table":
            raise ProblemAtError(
                (),
                "nothing strikes the box of a 'table'; name hockey or fetchslide, or diagnose recordings of "
                "a table with a rig file",
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
