"""Types of values that blocks of the configuration share: numbers with their bounds, names, lists.

Every number has both bounds. The bound away from zero is far beyond any reasonable value: it catches typing
errors that would fill a disk, and wrong units.
"""

from typing import Annotated, TypeAlias, TypeVar

from pydantic import AfterValidator, Field
from pydantic.json_schema import SkipJsonSchema

from slapshot.validation import LABEL, NAME, TITLE, ProblemAtError, short

T = TypeVar("T")


def _given(value: T) -> T:
    if value is None:
        raise ProblemAtError((), "null says nothing here; write a value or leave the key out")
    return value


def _unique(values: list[T]) -> list[T]:
    if len(set(values)) < len(values):
        raise ProblemAtError((), f"{short(values)} names something twice; name it once")
    return values


def ascending(values: list[T]) -> list[T]:
    """Return a pair [low, high] unchanged.

    Raises:
        ProblemAtError: high is less than low.
    """
    low, high = values
    if low > high:  # type: ignore[operator]
        raise ProblemAtError((), f"{short(values)} runs backwards; write [low, high] with low <= high")
    return values


def _box(values: list[float]) -> list[float]:
    if values[0] >= values[1] or values[2] >= values[3]:
        raise ProblemAtError(
            (),
            f"{short(values)} holds no place; write lowest x, highest x, lowest y, highest y, each lowest "
            "below its highest",
        )
    return values


MayMiss = Annotated[T | SkipJsonSchema[None], AfterValidator(_given)]
"""An optional key; null is not a valid value."""

# Whole numbers.
Seed = Annotated[int, Field(ge=0, le=2**32 - 1)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Few = Annotated[int, Field(ge=1, le=1_000)]
Models = Annotated[int, Field(ge=1, le=100)]
Steps = Annotated[int, Field(ge=2, le=10_000_000)]
Waypoints = Annotated[int, Field(ge=5, le=1_000)]
Hits = Annotated[int, Field(ge=1, le=10_000)]
"""Number of hits of a condition, or of an object of a recording."""
SampleCount = Annotated[int, Field(ge=0, le=10_000)]

# Numbers.
Share = Annotated[float, Field(ge=0, le=1)]
LearningRate = Annotated[float, Field(gt=0, le=1)]
Variance = Annotated[float, Field(ge=0, le=100)]
Mass = Annotated[float, Field(gt=0, le=1_000)]
Coefficient = Annotated[float, Field(ge=0, le=10)]
"""Coefficient of friction: dimensionless, or in m."""
PositiveCoefficient = Annotated[float, Field(gt=0, le=10)]
Coordinate = Annotated[float, Field(ge=-100, le=100)]
Length = Annotated[float, Field(gt=0, le=100)]
Distance = Annotated[float, Field(ge=0, le=100)]
Speed = Annotated[float, Field(gt=0, le=100)]
Duration = Annotated[float, Field(gt=0, le=60)]
Rate = Annotated[float, Field(gt=0, le=10_000)]
Scatter = Annotated[float, Field(ge=0, le=1)]
Ratio = Annotated[float, Field(ge=0, le=1_000)]
PositiveRatio = Annotated[float, Field(gt=0, le=1_000)]
Stiffness = Annotated[float, Field(gt=0, le=1_000_000)]

# Texts.
Name = Annotated[str, Field(pattern=NAME)]
"""Used in file names and command lines."""
Title = Annotated[str, Field(pattern=TITLE)]
"""Text for readers only."""
Text = Annotated[str, Field(max_length=200)]
Label = Annotated[str, Field(max_length=200, pattern=LABEL)]
"""Text in figures."""
FilePath = Annotated[str, Field(min_length=1, max_length=500)]

# Lists and ranges.
Several = Annotated[
    list[T], Field(max_length=1_000, json_schema_extra={"uniqueItems": True}), AfterValidator(_unique)
]
"""Distinct values; may be empty."""
SomeOf = Annotated[Several[T], Field(min_length=1)]
"""Distinct values, at least one."""
Widths = Annotated[tuple[Annotated[int, Field(ge=1, le=16_384)], ...], Field(min_length=1, max_length=16)]
"""Widths of hidden layers."""
Samples = SomeOf[SampleCount]
"""Numbers of hits to adapt to."""
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
"""x and y, m."""
Box = Annotated[list[Coordinate], Field(min_length=4, max_length=4), AfterValidator(_box)]
"""Lowest and highest x, lowest and highest y, m."""
Interval = Annotated[list[T], Field(min_length=2, max_length=2), AfterValidator(ascending)]
"""[low, high]."""
Range: TypeAlias = T | Annotated[list[T], Field(min_length=2, max_length=2), AfterValidator(ascending)]
"""A number, or the range [low, high] from which it is drawn."""
