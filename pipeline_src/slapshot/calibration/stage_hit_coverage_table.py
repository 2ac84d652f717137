"""Stage `hit_coverage_table`: do 90 % intervals of effects on hits hold 90 % of true values?"""

import pandas as pd

from slapshot.calibration.aims import Aim, percent, write_page
from slapshot.calibration.stage_coverage_table import coverage_table, describe, read_intervals
from slapshot.command import Run, stage_command
from slapshot.config.calibration import TableSettings

NAME = "hit_coverage"
POOLED_RANGE, LEAST = (0.85, 0.95), 0.70

INTRODUCTION = """# Coverage of 90 % intervals of effects on hits

Each effect's own law is the truth, with values drawn from its priors (what would lie beyond a bound, as half
of the draws of a drag, is put on it), on simulated tracks of hits whose launches nobody knows (by the
diagnosis' own slide; no real robot), seen at 50 Hz with noise of 3 mm, and with yaw where the effect follows
spin. That law alone is fitted, with the friction of the object and its scatter.
A fit that did not converge counts as one whose intervals miss. Widths are medians of (high - low) over the
size of the true value where that is not 0. Intervals of shares are Wilson's of 95 %. Maps of bumps, and
effects of swing and contact, which need commands, are not among them.
"""


def hit_coverage_aims(table: pd.DataFrame) -> list[Aim]:
    """Of all intervals together, and of each parameter."""
    pooled, each = table.iloc[-1], table.iloc[:-1]
    low, high = POOLED_RANGE
    value = float(pooled["held"])
    measured = f"{percent(value)} ({percent(pooled['held_low'])} to {percent(pooled['held_high'])})"
    below = each[each["held"] < LEAST]
    names = ", ".join(describe(row) for row in below.to_dict("records"))
    return [
        Aim("intervals that hold the truth, all", f"{percent(low)} to {percent(high)}", measured,
            low <= value <= high),
        Aim("parameters whose share is lower", f"none below {percent(LEAST)}", names or "none", below.empty),
    ]  # fmt: skip


def produce(run: Run) -> None:
    """Write hit_coverage.csv, the page and all intervals."""
    intervals = read_intervals(run.inputs[block] for block in run.settings(TableSettings).blocks)
    table = coverage_table(intervals)
    table.to_csv(run.out / f"{NAME}.csv", index=False, float_format="%.6g")
    intervals.to_csv(run.out / "intervals.csv", index=False, float_format="%.6g")
    write_page(run.out / f"{NAME}.md", INTRODUCTION, hit_coverage_aims(table), table)


if __name__ == "__main__":
    stage_command("hit_coverage_table", produce)
