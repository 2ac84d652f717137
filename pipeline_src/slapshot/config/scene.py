"""Block `scene` of a domain: robot, object and surroundings."""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag, field_validator

from slapshot.config.values import MayMiss, Point
from slapshot.own_code import MODULE
from slapshot.validation import Model, ProblemAtError

CONTROL_PERIOD = 0.001  # s; a multiple of the integration step


def _divides_control_period(timestep: float) -> float:
    steps = CONTROL_PERIOD / timestep
    if abs(steps - round(steps)) > 1e-9 * steps:
        raise ProblemAtError(
            (),
            f"{timestep} does not divide {CONTROL_PERIOD} s; use 0.001, 0.0005, 0.00025 or another whole "
            "part",
        )
    return timestep


# The step must resolve the time constant of contacts, 5 ms: above 1 ms rest points move by centimetres. Below
# 10 microseconds they no longer change, and a hit of 2 s takes more than 200,000 steps.
Timestep = Annotated[
    float,
    Field(ge=1e-5, le=CONTROL_PERIOD, description="integration step in s; divides 1 ms"),
    AfterValidator(_divides_control_period),
]
# Bounds are larger than any laboratory or field of view.
Coordinate = Annotated[float, Field(ge=-100, le=100, description="m")]
Extent = Annotated[float, Field(ge=0.01, le=100, description="m, extent of a surface")]

PuckName = Literal["inline", "ice"]

# Distances from axis 1. The farthest is that of the blade's centre with a horizontal, stretched arm: links of
# 0.4 and 0.39 m, 0.078 m to the flange, 0.5 m of stick. The nearest is the radius of the arm's base, 0.15 m.
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
        description="folder of slapshot.domains, or dotted name of a user's own module",
    )


class HockeySettings(SceneSettings):
    """A puck in front of an arm with a stick, for hockey or a user's own domain that builds on it."""

    puck: PuckName = Field(description="type of commercial puck")
    timestep_s: Timestep
    start_m: Annotated[tuple[Coordinate, Coordinate], AfterValidator(_within_reach)] = Field(
        description="x, y in m of the puck's nominal start"
    )
    board_m: tuple[Extent, Extent] = Field(description="extent in m along x and y of the visible whiteboard")


class HockeyScene(HockeySettings):
    """A puck on a whiteboard, and an arm with a stick."""

    joints: ClassVar[int] = 7
    domain: Literal["hockey"] = Field(description="built in")


class FetchslideScene(SceneSettings):
    """The unchanged environment of gymnasium-robotics."""

    joints: ClassVar[None] = None  # commands are not joint positions, and there are no stand-in rigs of it
    domain: Literal["fetchslide"] = Field(description="built in")


class OwnScene(SceneSettings):
    """A user's own domain, whose module validates all other keys."""

    model_config = ConfigDict(extra="allow")

    joints: ClassVar[None] = None  # known to its module only
    timestep_s: MayMiss[Timestep] = Field(default=None, description="s; divides 1 ms")
    start_m: MayMiss[Point] = Field(default=None, description="x, y in m of the object's nominal start")

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
