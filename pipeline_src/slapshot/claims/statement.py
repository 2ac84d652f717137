"""Interface of all claims: statements with a measured value, an interval and a verdict."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.json_types import Row
from slapshot.statistics import Interval


@dataclass(frozen=True)
class Statement:
    """A part of a claim that is decided by one number.

    Attributes:
        text: the claim, in one sentence.
        measure: what the number is.
        interval: the number and its 95 % interval.
        above, below: the statement holds if the number lies above the one and below the other.
        unit: of the number.
        scale: factor between the number and how it is printed in that unit.
        paper: what the paper reports, if it gives a number.
        note: context for the reader.
    """

    text: str
    measure: str
    interval: Interval
    above: float = -math.inf
    below: float = math.inf
    unit: str = ""
    scale: float = 1.0
    paper: str = ""
    note: str = ""

    @property
    def verdict(self) -> str:
        """Holds, or does not hold, if the whole interval agrees; otherwise undecided."""
        low, high = self.interval.low, self.interval.high
        # Without a limit an infinite value is acceptable: a method that diverged is behind.
        above_it = self.above == -math.inf or low > self.above
        if above_it and (self.below == math.inf or high < self.below):
            return "holds"
        if high < self.above or low > self.below:
            return "does not hold"
        return "undecided"

    def row(self) -> Row:
        """As a row of a table."""
        interval = self.interval
        return {
            "text": self.text,
            "measure": self.measure,
            "value": interval.value,
            "low": interval.low,
            "high": interval.high,
            "above": self.above,
            "below": self.below,
            "unit": self.unit,
            "scale": self.scale,
            "paper": self.paper,
            "verdict": self.verdict,
            "note": self.note,
        }


class ClaimModule(Protocol):
    """A module of this package that evaluates one claim."""

    TITLE: str

    def evaluate(self, inputs: Mapping[str, Path]) -> list[Statement]:
        """Statements, from upstream version folders (role -> folder)."""


def error_array(errors: pd.DataFrame, task: str | list[str]) -> NDArray[np.float64]:
    """(models, tasks, samples + 1) mean error in m from a long table; `task`: columns of a task."""
    keys = ["model", *([task] if isinstance(task, str) else task), "samples"]
    mean = errors.groupby(keys, observed=True)["error_m"].mean().unstack("samples").unstack("model")
    models = errors["model"].nunique()
    values = mean.to_numpy(float).reshape(len(mean), -1, models)
    return values.transpose(2, 0, 1)
