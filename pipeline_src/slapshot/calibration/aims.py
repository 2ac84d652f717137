"""Aims of a calibration, whether they are met, and the report page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from slapshot.statistics import wilson_interval
from slapshot.text import markdown_table


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
    share = wilson_interval(int(yes.sum()), len(yes))
    return share.value, share.low, share.high


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
        markdown_table(("measure", "aim", "measured", "reached"), lines),
        "\n## All\n",
        markdown_table(list(table.columns), rows),
    ]
    file.write_text("\n".join(parts) + "\n")


def _cell(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
