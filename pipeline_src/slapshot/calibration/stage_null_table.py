"""Stage `null_table`: are p-values of nulls uniform?"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import kstest, kstwo

from slapshot.calibration.aims import Aim, percent, wilson_share, write_page
from slapshot.command import Run, stage_command
from slapshot.config.calibration import TableSettings
from slapshot.plotting import METHOD_COLOURS, OTHER_COLOURS, STAND_IN, Drawing, save, use_style

NAME = "joint_nulls"
POOLED = "all"
BELOW = {"below_05": (0.05, 0.035, 0.065), "below_01": (0.01, 0.004, 0.018)}  # level, and aim of the pooled
MIN_KS_P_VALUE = 1e-3
MOST_CLUTTERED = 0.05  # share of cluttered nulls that may be called a mismatch

INTRODUCTION = """# P-values of rigs that conceal nothing

Recordings by the joint lab (simulated; no real robot) of rigs that conceal nothing, and the p-value of the
first test of a diagnosis. Where a rig is as its nominal model says, p-values are uniform if they are what
they say; the row "{pooled}" is of these. A p-value is made of one from draws, a multiple of 1/500, and one of
a formula: its distribution has steps of at most .004,
which are small beside what the Kolmogorov-Smirnov test can see of {n} recordings (a distance of {seen:.3f}
at its level of .05), so that they count as continuous. Intervals are Wilson's of 95 %.
Aims are of all rigs pooled, but for Kolmogorov-Smirnov's p-value, which is of each rig, and for cluttered
recordings, which are apart: there the rig's own laws err by 10 %, sample times jitter, noise has outliers and
grows or shrinks over the session, and readings drift. Their p-values are uniform only as far as the diagnosis
knows such errors; what counts is how many would be called a mismatch.
"""


def null_table(p_values: pd.DataFrame) -> pd.DataFrame:
    """Shares below levels and the Kolmogorov-Smirnov test, rig by rig and pooled.

    Args:
        p_values: columns rig, cluttered and p_value.
    """
    clean = p_values[~p_values["cluttered"]]
    groups = [(str(rig), own) for rig, own in p_values.groupby("rig", sort=False)]
    rows = []
    for rig, own in [*groups, *([(POOLED, clean)] if len(clean) else [])]:
        values = own["p_value"]
        row: dict[str, object] = {"rig": rig, "cluttered": bool(own["cluttered"].any()), "n": len(values)}
        for column, (level, *_) in BELOW.items():
            row[column], row[f"{column}_low"], row[f"{column}_high"] = wilson_share(values < level)
        test = kstest(values, "uniform")
        rows.append(row | {"ks_distance": float(test.statistic), "ks_p": float(test.pvalue)})
    return pd.DataFrame(rows)


def null_aims(table: pd.DataFrame) -> list[Aim]:
    """What the pooled shares and each rig's test should be."""
    aims = []
    for pooled in table[table["rig"] == POOLED].to_dict("records"):
        for column, (level, low, high) in BELOW.items():
            wanted = f"{percent(low)} to {percent(high)}"
            reached = low <= float(pooled[column]) <= high
            aims.append(Aim(f"share of p-values below {level}", wanted, _share(pooled, column), reached))
    for row in table[table["rig"] != POOLED].to_dict("records"):
        if row["cluttered"]:
            level, wanted = BELOW["below_01"][0], f"at most {percent(MOST_CLUTTERED)}"
            name = f"share of p-values below {level}, {row['rig']}"
            reached = float(row["below_01"]) <= MOST_CLUTTERED
            aims.append(Aim(name, wanted, _share(row, "below_01"), reached))
        else:
            p_value, wanted = float(row["ks_p"]), f"above {MIN_KS_P_VALUE:g}"
            name = f"Kolmogorov-Smirnov, {row['rig']}"
            aims.append(Aim(name, wanted, f"{p_value:.2g}", p_value > MIN_KS_P_VALUE))
    return aims


def _share(row: Mapping[Any, Any], column: str) -> str:
    return f"{percent(row[column])} ({percent(row[f'{column}_low'])} to {percent(row[f'{column}_high'])})"


def draw_nulls(p_values: pd.DataFrame) -> Drawing:
    """Empirical distributions against the diagonal with the band that holds 95 % of uniform ones."""
    use_style()
    figure, axes = plt.subplots(figsize=(6.6, 4.2))
    colours = (*list(METHOD_COLOURS.values())[:2], *OTHER_COLOURS)
    groups = list(p_values.groupby("rig", sort=False))
    fewest = min(len(own) for _, own in groups)
    band, level = float(kstwo.ppf(0.95, fewest)), np.linspace(0, 1, 101)
    axes.fill_between(
        level, np.clip(level - band, 0, 1), np.clip(level + band, 0, 1), color="#DDDDDD", lw=0,
        label=f"95 % of uniform ones, n = {fewest}",
    )  # fmt: skip
    axes.plot(level, level, color="#888888", lw=1, ls=":")
    tables = []
    for (rig, own), colour in zip(groups, np.resize(colours, len(groups)), strict=True):
        values = np.sort(own["p_value"].to_numpy(float))
        below = np.arange(1, len(values) + 1) / len(values)
        text = f"{str(rig).replace('_', ' ')} (n = {len(values)})"
        axes.step([0, *values, 1], [0, *below, 1], where="post", lw=1.4, color=colour, label=text)
        tables.append(pd.DataFrame({"rig": rig, "p_value": values, "share": below}))
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="p-value", ylabel="share of nulls at most so large")
    axes.set_aspect("equal", anchor="W")
    axes.legend(loc="upper left", bbox_to_anchor=(1.03, 1.0), fontsize="small")
    axes.set_title(f"Nulls; {STAND_IN}", loc="left")
    return Drawing(NAME, figure, pd.concat(tables))


def write_nulls(p_values: pd.DataFrame, folder: Path) -> None:
    """Write joint_nulls.csv, .md, .png and .pdf, and every p-value."""
    table = null_table(p_values)
    save(draw_nulls(p_values), folder)
    (folder / f"{NAME}.csv").rename(folder / "distributions.csv")
    table.to_csv(folder / f"{NAME}.csv", index=False, float_format="%.6g")
    p_values.to_csv(folder / "p_values.csv", index=False, float_format="%.6g")
    fewest = int(table["n"].min())
    text = INTRODUCTION.format(pooled=POOLED, n=fewest, seen=kstwo.ppf(0.95, fewest))
    write_page(folder / f"{NAME}.md", text, null_aims(table), table)


def produce(run: Run) -> None:
    """Write joint_nulls.csv, the page, the figure and all p-values."""
    blocks = [pd.read_csv(run.inputs[block] / "p_values.csv") for block in run.settings(TableSettings).blocks]
    write_nulls(pd.concat(blocks, ignore_index=True), run.out)


if __name__ == "__main__":
    stage_command("null_table", produce)
