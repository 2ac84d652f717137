"""Block `randomisation` of a domain: what is drawn for every condition, and for every hit."""

from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from slapshot.config.values import Coefficient, Coordinate, Interval, Label, Mass, MayMiss, Text
from slapshot.validation import Model, ProblemAtError

# Parameters that every scene understands, in SI units: kg, 1, 1, m, m.
CONDITION_PARAMETERS = (
    "mass",
    "friction_x",
    "friction_y",
    "friction_torsional",
    "friction_rolling",
)

_SAFE_SPREADS = 5  # a normal draw is taken to stay within so many standard deviations


class Draw(Model):
    """What a parameter is drawn from: uniform or normal, and perhaps times another parameter."""

    uniform: MayMiss[Annotated[list[float], Field(min_length=2, max_length=2)]] = Field(
        default=None, description="[low, high]"
    )
    normal: MayMiss[Annotated[list[Coordinate], Field(min_length=2, max_length=2)]] = Field(
        default=None, description="[mean, standard deviation]"
    )
    times: MayMiss[Text] = Field(default=None, description="another parameter that scales the draw")

    @property
    def numbers(self) -> tuple[float, float]:
        """Low and high, or mean and standard deviation."""
        given = self.uniform or self.normal
        assert given is not None
        return given[0], given[1]

    def within(self, low: float, high: float) -> "Draw":
        """Drawn uniformly from another range; what scales it stays."""
        uniform = [low, high]
        return Draw(uniform=uniform) if self.times is None else Draw(uniform=uniform, times=self.times)


class Draws(Model):
    """What conditions and start errors are drawn from, without what only pictures show."""

    mass: Draw
    friction_x: Draw
    friction_y: Draw
    friction_torsional: Draw
    friction_rolling: Draw
    start_error: Draw

    def of_parameter(self, name: str) -> Draw:
        """What the parameter of that name is drawn from."""
        draw: Draw = getattr(self, name)
        return draw


class Distribution(Draw):
    """What a parameter is drawn from, and what it is called."""

    nonnegative: ClassVar[bool] = True
    label: Label = Field(description="for pictures")
    unit: Label = Field(description="for pictures")

    @model_validator(mode="after")
    def _one_shape(self) -> "Distribution":
        given = [key for key in ("uniform", "normal") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ProblemAtError(
                (), f"has {' and '.join(given) or 'none'} of uniform, normal; give exactly one of them"
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

    uniform: MayMiss[Interval[Mass]] = Field(default=None, description="[low, high]")


class FrictionDistribution(Distribution):
    """Of what may be 0, but not for all conditions: an object without friction never rests."""

    uniform: MayMiss[Interval[Coefficient]] = Field(default=None, description="[low, high]")


class StartErrorDistribution(Distribution):
    """Of what may be negative."""

    nonnegative: ClassVar[bool] = False
    uniform: MayMiss[Interval[Coordinate]] = Field(default=None, description="[low, high]")


class Randomisation(Draws):
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
            draw = self.of_parameter(parameter)
            drawn = CONDITION_PARAMETERS
            earlier = drawn[: drawn.index(parameter)] if parameter in drawn else ()
            if draw.times is not None and draw.times not in earlier:
                advice = f"use one of: {', '.join(earlier)}" if earlier else "leave `times` out"
                raise ProblemAtError(
                    (parameter, "times"), f"no parameter {draw.times!r} is drawn before {parameter}; {advice}"
                )
        for parameter in ("friction_x", "friction_y"):
            if self.of_parameter(parameter).uniform == [0, 0]:
                raise ProblemAtError(
                    (parameter, "uniform"),
                    "[0, 0] is no friction, so that nothing comes to rest; write a high > 0",
                )
        return self
