"""A5: predictions on new hits of a rig, with models of full and refined ranges (proposed in the paper)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.ticker import MaxNLocator

from slapshot.config.results import FigureSettings
from slapshot.error_curves import summarise
from slapshot.parquet import read_frame
from slapshot.plotting import STAND_IN, Drawing

_ARMS = {
    "all ranges": ("#0072B2", "-", "trained on all ranges"),
    "refined ranges": ("#D55E00", "--", "trained on the rig's refined ranges"),
}


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """One panel for each rig (role): error against samples, with 95 % bands of the mean over models."""
    figure, grid = plt.subplots(
        1, len(inputs), figsize=(max(4.6, 3.4 * len(inputs)), 3.6), squeeze=False, sharey=True
    )
    tables = []
    for axes, (rig, folder) in zip(grid[0], inputs.items(), strict=True):
        summary = summarise(read_frame(folder / "errors.parquet"), ["arm"])
        for arm, (colour, line, label) in _ARMS.items():
            rows = summary[summary["arm"] == arm]
            axes.plot(rows["samples"], 100 * rows["error_m"], color=colour, linestyle=line, label=label)
            axes.fill_between(
                rows["samples"], 100 * rows["mean_low_m"], 100 * rows["mean_high_m"], color=colour,
                alpha=0.15, lw=0,
            )  # fmt: skip
        axes.set_title(f"rig {rig}, two pucks", loc="left")
        axes.set_xlim(0, summary["samples"].max())
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("samples seen")
        tables.append(summary.assign(rig=rig))
    grid[0, 0].set_ylim(bottom=0)
    grid[0, 0].set_ylabel("distance between predicted and\ntrue rest point (cm)")
    grid[0, 0].legend(loc="upper right")
    figure.suptitle(STAND_IN, fontsize=8, color="#A00000")
    return Drawing(f"A5-{settings.domain}-refined", figure, pd.concat(tables, ignore_index=True))
