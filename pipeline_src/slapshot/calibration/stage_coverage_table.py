"""Stage `coverage_table`: do 90 % intervals hold 90 % of true values?"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from slapshot.calibration.aims import Aim, percent, wilson_share, write_page
from slapshot.command import Run, stage_command
from slapshot.config.calibration import TableSettings

NAME = "coverage"
POOLED_RANGE, PARAMETER_RANGE = (0.88, 0.92), (0.80, 0.97)
_KEYS = ["effect", "variant", "rig", "parameter"]

INTRODUCTION = """# Coverage of 90 % intervals

Each effect's own law is the truth, with values drawn from its priors, on the simplest rig that it shows on
(simulated apart from the engine; no real robot), with white noise of 1 mrad or mm. That law alone is fitted,
the noise with it. A fit that did not converge (to a tenth of a standard deviation) counts as one whose
intervals miss. Widths are medians of (high - low) over the size of the true value. Intervals of shares are
Wilson's of 95 %, the parameters of one fit being counted as if they were independent.
"""


def coverage_table(intervals: pd.DataFrame) -> pd.DataFrame:
    """Share of intervals that contain the true value, for each parameter and pooled.

    Args:
        intervals: columns effect, variant, rig, parameter, truth, low, high, converged.
    """
    held = intervals["converged"] & intervals["truth"].between(intervals["low"], intervals["high"])
    size = intervals["truth"].abs()
    width = (intervals["high"] - intervals["low"]) / size.where(size > 0)
    scored = intervals.assign(held=held, width=width, failed=~intervals["converged"])
    parts = list(scored.groupby(_KEYS, sort=False))
    rows = [dict(zip(_KEYS, key, strict=True)) | _measured(own) for key, own in parts]
    rows.append(dict.fromkeys(_KEYS, "") | {"effect": "all"} | _measured(scored))
    return pd.DataFrame(rows)


def _measured(scored: pd.DataFrame) -> dict[str, object]:
    held, low, high = wilson_share(scored["held"])
    return {
        "n": len(scored),
        "held": held,
        "held_low": low,
        "held_high": high,
        "width_over_value": float(np.nanmedian(scored["width"])) if scored["width"].notna().any() else np.nan,
        "not_converged": float(scored["failed"].mean()),
    }


def coverage_aims(table: pd.DataFrame) -> list[Aim]:
    """Of all intervals together, and of each parameter."""
    pooled, each = table.iloc[-1], table.iloc[:-1]
    (low, high), (least, most) = POOLED_RANGE, PARAMETER_RANGE
    value = float(pooled["held"])
    measured = f"{percent(value)} ({percent(pooled['held_low'])} to {percent(pooled['held_high'])})"
    outside = each[~each["held"].between(least, most)]
    names = ", ".join(describe(row) for row in outside.to_dict("records"))
    return [
        Aim("intervals that hold the truth, all", f"{percent(low)} to {percent(high)}", measured,
            low <= value <= high),
        Aim("parameters whose share is outside", f"none outside {percent(least)} to {percent(most)}",
            names or "none", outside.empty),
    ]  # fmt: skip


def describe(row: Mapping[Any, Any]) -> str:
    """A row of the table in words."""
    variant = f" ({row['variant']})" if row["variant"] else ""
    return f"{row['parameter']} of {row['effect']}{variant}: {percent(row['held'])}"


def write_coverage(intervals: pd.DataFrame, folder: Path) -> None:
    """Write coverage.csv, coverage.md, and every interval."""
    table = coverage_table(intervals)
    table.to_csv(folder / f"{NAME}.csv", index=False, float_format="%.6g")
    intervals.to_csv(folder / "intervals.csv", index=False, float_format="%.6g")
    write_page(folder / f"{NAME}.md", INTRODUCTION, coverage_aims(table), table)


def read_intervals(blocks: Iterable[Path]) -> pd.DataFrame:
    """Intervals of blocks of recordings, one after the other."""
    texts = {"variant": str, "state": str}
    missing = {"value": [""], "low": [""], "high": [""]}
    tables = (
        pd.read_csv(block / "intervals.csv", dtype=texts, keep_default_na=False, na_values=missing)
        for block in blocks
    )
    return pd.concat(tables, ignore_index=True)


def produce(run: Run) -> None:
    """Write coverage.csv, the page and all intervals."""
    blocks = run.settings(TableSettings).blocks
    write_coverage(read_intervals(run.inputs[block] for block in blocks), run.out)


if __name__ == "__main__":
    stage_command("coverage_table", produce)
