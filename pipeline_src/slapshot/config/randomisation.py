"""Block `randomisation` of a domain: distributions of the parameters of conditions and of start errors."""

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

_SAFE_SPREADS = 5  # normal draws are assumed to stay within this number of standard deviations


class Draw(Model):
    """Distribution of a parameter: uniform or normal, optionally as a multiple of another parameter."""

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
        """A uniform distribution over another range, scaled by the same parameter."""
        uniform = [low, high]
        return Draw(uniform=uniform) if self.times is None else Draw(uniform=uniform, times=self.times)


class Draws(Model):
    """Distributions of conditions and start errors, without labels for figures."""

    mass: Draw
    friction_x: Draw
    friction_y: Draw
    friction_torsional: Draw
    friction_rolling: Draw
    start_error: Draw

    def of_parameter(self, name: str) -> Draw:
        """Distribution of the parameter `name`."""
        draw: Draw = getattr(self, name)
        return draw


class Distribution(Draw):
    """Distribution of a parameter with its label and unit."""

    nonnegative: ClassVar[bool] = True
    label: Label = Field(description="for figures")
    unit: Label = Field(description="for figures")

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
    """Distribution of a mass, which is positive."""

    uniform: MayMiss[Interval[Mass]] = Field(default=None, description="[low, high]")


class FrictionDistribution(Distribution):
    """Distribution of a coefficient of friction; 0 is allowed, but not always, or no object comes to rest."""

    uniform: MayMiss[Interval[Coefficient]] = Field(default=None, description="[low, high]")


class StartErrorDistribution(Distribution):
    """Distribution of a displacement, which may be negative."""

    nonnegative: ClassVar[bool] = False
    uniform: MayMiss[Interval[Coordinate]] = Field(default=None, description="[low, high]")


class Randomisation(Draws):
    """Distributions of conditions and start errors."""

    mass: MassDistribution = Field(description="kg")
    friction_x: FrictionDistribution = Field(description="of object and plane, along x")
    friction_y: FrictionDistribution = Field(description="along y")
    friction_torsional: FrictionDistribution = Field(description="m")
    friction_rolling: FrictionDistribution = Field(description="m")
    start_error: StartErrorDistribution = Field(description="m, along x and along y, drawn for every hit")

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
