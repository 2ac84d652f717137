"""What the block `scene` of hockey may say."""

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from slapshot.scenes.settings import Coordinate, Extent, SceneSettings, Timestep

PuckName = Literal["inline", "ice"]

# From axis 1 to the middle of the blade of an arm that lies flat: links of 0.4 and 0.39 m, 0.078 m to the
# flange, 0.5 m of stick. The arm's own foot takes 0.15 m.
NEAREST, FARTHEST = 0.15, 1.37  # m


def _within_reach(start: tuple[float, float]) -> tuple[float, float]:
    distance = math.hypot(*start)
    if not NEAREST <= distance <= FARTHEST:
        raise ValueError(
            f"{list(start)} is {distance:g} m from the robot's axis 1; put the puck within reach of the "
            f"stick, {NEAREST:g} to {FARTHEST:g} m from it"
        )
    return start


class HockeyScene(SceneSettings):
    """A puck before an arm with a stick."""

    puck: PuckName = Field(description="which puck one buys")
    timestep_s: Timestep
    start_m: Annotated[tuple[Coordinate, Coordinate], AfterValidator(_within_reach)] = Field(
        description="x, y in m where the puck is meant to lie"
    )
    board_m: tuple[Extent, Extent] = Field(description="x, y in m of the whiteboard that one sees")
