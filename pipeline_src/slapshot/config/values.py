"""Kinds of values that blocks of the configuration share: numbers with their bounds, names, lists.

Every number has both bounds. The one away from zero is far beyond any use: it keeps a slip of the keyboard
from filling a disk, and a wrong unit from being simulated.
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
    """A pair as it is.

    Raises:
        ProblemAtError: its second number is below its first.
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
"""A key that may be left out; null is no value for it."""

# Whole numbers.
Seed = Annotated[int, Field(ge=0, le=2**32 - 1)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Few = Annotated[int, Field(ge=1, le=1_000)]
Models = Annotated[int, Field(ge=1, le=100)]
Steps = Annotated[int, Field(ge=2, le=10_000_000)]
Waypoints = Annotated[int, Field(ge=5, le=1_000)]
Hits = Annotated[int, Field(ge=1, le=10_000)]
"""Of a condition, or of an object of a recording."""
SampleCount = Annotated[int, Field(ge=0, le=10_000)]

# Numbers.
Share = Annotated[float, Field(ge=0, le=1)]
LearningRate = Annotated[float, Field(gt=0, le=1)]
Variance = Annotated[float, Field(ge=0, le=100)]
Mass = Annotated[float, Field(gt=0, le=1_000)]
Coefficient = Annotated[float, Field(ge=0, le=10)]
"""Of friction: without unit, or m."""
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
"""Becomes part of file names and of command lines."""
Title = Annotated[str, Field(pattern=TITLE)]
"""Is only read."""
Text = Annotated[str, Field(max_length=200)]
Label = Annotated[str, Field(max_length=200, pattern=LABEL)]
"""Stands in pictures."""
FilePath = Annotated[str, Field(min_length=1, max_length=500)]

# Lists and ranges.
Several = Annotated[
    list[T], Field(max_length=1_000, json_schema_extra={"uniqueItems": True}), AfterValidator(_unique)
]
"""Values of which none stands twice; perhaps none."""
SomeOf = Annotated[Several[T], Field(min_length=1)]
"""Values of which none stands twice; at least one."""
Widths = Annotated[tuple[Annotated[int, Field(ge=1, le=16_384)], ...], Field(min_length=1, max_length=16)]
"""Of hidden layers."""
Samples = SomeOf[SampleCount]
"""Numbers of hits seen."""
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
"""x and y, m."""
Box = Annotated[list[Coordinate], Field(min_length=4, max_length=4), AfterValidator(_box)]
"""Lowest and highest x, lowest and highest y, m."""
Interval = Annotated[list[T], Field(min_length=2, max_length=2), AfterValidator(ascending)]
"""[low, high]."""
Range: TypeAlias = T | Annotated[list[T], Field(min_length=2, max_length=2), AfterValidator(ascending)]
"""A number, or [low, high] that it is drawn from."""
