"""A1: distance to targets on the rigs, of commands chosen by adapted models (proposed in the paper)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

from slapshot.config.results import FigureSettings
from slapshot.error_curves import summarise
from slapshot.parquet import read_frame
from slapshot.plotting import OTHER_COLOURS, STAND_IN, Drawing

ORACLE, INVERSE = "oracle", "inverse model"
_LINES = ("-", "--", "-.", ":")


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Error against samples seen, one line for each action optimiser; 95 % intervals over rigs."""
    table = pd.concat([read_frame(f / "acting.parquet") for f in inputs.values()], ignore_index=True)
    # Only the method with an inverse model; other methods belong to figure A4.
    believing = table.loc[table["chooser"] == INVERSE, "method"].iloc[0]
    table = table[table["method"].isin([believing, ""])]
    summary = summarise(table.dropna(subset="error_m"), ["chooser"], unit="rig")
    figure, axes = plt.subplots(figsize=(5.6, 3.9))
    choosers = [c for c in dict.fromkeys(table["chooser"]) if c != ORACLE]
    # Evenly spaced, since numbers of samples double.
    places = {n: i for i, n in enumerate(sorted(table.loc[table["samples"] >= 0, "samples"].unique()))}
    for number, (chooser, colour, line) in enumerate(
        zip(choosers, ("#0072B2", *OTHER_COLOURS), _LINES, strict=False)
    ):
        rows = summary[summary["chooser"] == chooser]
        at = rows["samples"].map(places) + 0.05 * (number - 1)
        below, above = rows["error_m"] - rows["mean_low_m"], rows["mean_high_m"] - rows["error_m"]
        axes.errorbar(
            at, 100 * rows["error_m"], yerr=[100 * below, 100 * above], color=colour, linestyle=line,
            marker="o", ms=3.5, capsize=2.5, lw=1.6, elinewidth=1, label=chooser,
        )  # fmt: skip
    floor = summary[summary["chooser"] == ORACLE].iloc[0]
    low, level, high = (100 * float(floor[k]) for k in ("mean_low_m", "error_m", "mean_high_m"))
    axes.axhspan(low, high, color="#DDDDDD", lw=0)
    axes.axhline(level, color="#555555", lw=1, label="oracle: repeats a command that leads there")
    axes.set_xticks(list(places.values()), [str(n) for n in places])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("hits of the rig seen")
    axes.set_ylabel("distance between target and rest point (cm)")
    axes.legend(loc="upper right")
    rigs = table["rig"].nunique()
    axes.set_title(f"{rigs} rig{'s' * (rigs > 1)}, two pucks; {STAND_IN}", loc="left", fontsize=8)
    return Drawing(f"A1-{settings.domain}-acting", figure, summary)
