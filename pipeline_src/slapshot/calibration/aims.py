"""Aims of a calibration, whether they are met, and the report page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binomtest


@dataclass(frozen=True)
class Aim:
    """The target of a measured quantity.

    Attributes:
        of: the measured quantity.
        wanted: target, as text.
        measured: result, as text.
        reached: whether the target is met.
    """

    of: str
    wanted: str
    measured: str
    reached: bool


def wilson_share(yes: pd.Series) -> tuple[float, float, float]:
    """Share of true values with Wilson's 95 % interval."""
    if not len(yes):
        return np.nan, np.nan, np.nan
    interval = binomtest(int(yes.sum()), len(yes)).proportion_ci(0.95, method="wilson")
    return float(yes.mean()), interval.low, interval.high


def percent(value: float) -> str:
    """A share in percent, with one decimal."""
    return f"{100 * value:.1f} %"


def write_page(file: Path, introduction: str, aims: Sequence[Aim], table: pd.DataFrame) -> None:
    """Introduction, a line for each aim, and the table."""
    lines = [(a.of, a.wanted, a.measured, "yes" if a.reached else "**no**") for a in aims]
    rows = [[_cell(value) for value in row] for row in table.itertuples(index=False)]
    parts = [
        introduction,
        "## Aims\n",
        *markdown(("measure", "aim", "measured", "reached"), lines),
        "\n## All\n",
        *markdown(list(table.columns), rows),
    ]
    file.write_text("\n".join(parts) + "\n")


def _cell(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table."""
    return ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows)]
