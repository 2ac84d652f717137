"""A3: randomisation ranges refined by beliefs about recorded rigs, and the truth (proposed in the paper)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from slapshot.config.results import FigureSettings
from slapshot.parquet import read_frame
from slapshot.plotting import STAND_IN, Drawing

_TITLES = {
    "friction_x": "friction along x",
    "friction_y": "friction along y over that along x",
    "mass": "mass (kg)",
    "friction_torsional": "torsional friction (m)",
}
_COLOURS = {"red": "#D62728", "blue": "#1F4FB4"}


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """One panel for each parameter: 5 to 95 % range and median of every rig and puck, truth, prior range."""
    (folder,) = inputs.values()
    table = read_frame(folder / "coverage.parquet")
    simulated = read_frame(folder / "simulated.parquet").groupby("parameter")["inside"]
    table = table.join(simulated.agg(simulated_share="mean", simulated_n="size"), on="parameter")
    return draw_table(table, settings.domain)


def draw_table(table: pd.DataFrame, domain: str) -> Drawing:
    """Draw from the figure's own table: rigs, with the share inside in simulation.

    Args:
        table: of coverage.parquet, with simulated_share and simulated_n (conditions) of each parameter.
        domain: its name in the configuration.
    """
    figure, panels = plt.subplots(1, len(_TITLES), figsize=(11, 4.4), sharey=True)
    rigs = sorted(table["rig"].unique())
    objects = list(dict.fromkeys(table["object"]))
    for axes, (parameter, title) in zip(panels, _TITLES.items(), strict=True):
        own = table[table["parameter"] == parameter]
        axes.axvspan(own["prior_low"].iloc[0], own["prior_high"].iloc[0], color="#EFEFEF", lw=0)
        for number, name in enumerate(objects):
            rows = own[own["object"] == name].sort_values("rig")
            at = np.searchsorted(rigs, rows["rig"]) + 0.36 * (number - (len(objects) - 1) / 2)
            colour = _COLOURS.get(name, "#444444")
            axes.hlines(at, rows["low"], rows["high"], color=colour, lw=1.6, alpha=0.75)
            axes.plot(rows["median"], at, "|", color=colour, ms=5, label=f"{name} puck, 5 to 95 %")
            axes.plot(
                rows["truth"], at, "x", color="black", ms=4, mew=1, label="truth" if not number else None
            )
        axes.set_title(f"{title}\n{_inside(own)}", loc="left", fontsize=8)
        if own["prior_high"].iloc[0] > 20 * own["prior_low"].iloc[0]:
            axes.set_xscale("log")
    panels[0].set_yticks(range(len(rigs)), [str(rig) for rig in rigs], fontsize=7)
    panels[0].set_ylabel("rig")
    lines, texts = panels[0].get_legend_handles_labels()
    figure.legend(lines, texts, loc="outside lower center", ncols=len(lines))
    figure.suptitle(
        f"grey: what training drew from; truths outside of it are left out; {STAND_IN}", fontsize=8
    )
    return Drawing(f"A3-{domain}-refinement", figure, table)


def _inside(own: pd.DataFrame) -> str:
    """Count of true values inside their range, of those within the training prior."""
    drawable = own[own["drawable"].astype(bool)]
    inside, count = int(drawable["inside"].sum()), len(drawable)
    counted = f"{inside} of {count} ({100 * inside / count:.0f} %)" if count else "none could be drawn"
    outside = len(own) - count
    beyond = f"; {outside} left out" if outside and count else ""
    share, conditions = own["simulated_share"].iloc[0], int(own["simulated_n"].iloc[0])
    return f"truths inside: {counted}{beyond}\nin simulation: {100 * share:.0f} % of {conditions} conditions"
