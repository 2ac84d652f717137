"""What the blocks `scene` of all domains have in common; each domain adds its own keys in its settings.py."""

from typing import Annotated

from pydantic import AfterValidator, Field

from slapshot.own_code import MODULE
from slapshot.validation import Model

CONTROL_PERIOD = 0.001  # s; commands are sent at whole steps of integration


def _divides_control_period(timestep: float) -> float:
    steps = CONTROL_PERIOD / timestep
    if abs(steps - round(steps)) > 1e-9 * steps:
        raise ValueError(
            f"{timestep} does not divide {CONTROL_PERIOD} s; use 0.001, 0.0005, 0.00025 or another whole part"
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


class SceneSettings(Model):
    """Base of the block `scene` of a domain."""

    domain: str = Field(
        pattern=MODULE,
        max_length=200,
        description="folder of slapshot.domains, or dotted name of a module of one's own",
    )
