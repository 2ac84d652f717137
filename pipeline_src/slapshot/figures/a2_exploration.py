"""A2: error against samples, for informed exploration and for sampled latents (proposed in the paper)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.ticker import MaxNLocator

from slapshot.config.results import FigureSettings
from slapshot.error_curves import summarise
from slapshot.parquet import read_frame
from slapshot.plotting import STAND_IN, Drawing

FEW = 8
_ARMS = {
    "informed": ("#0072B2", "-", "hits that the belief chooses"),
    "sampled": ("#E69F00", "--", "sampled latents"),
}


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Both arms over all samples, and zoomed in on the first; 95 % bands over rigs, or models of one rig."""
    (folder,) = inputs.values()
    errors = read_frame(folder / "exploration.parquet")
    rigs = errors["rig"].nunique()
    summary = summarise(errors, ["arm"], "rig" if rigs > 1 else "model")
    figure, (whole, zoomed) = plt.subplots(1, 2, figsize=(8.4, 3.6))
    for axes, last in ((whole, summary["samples"].max()), (zoomed, FEW)):
        for arm, (colour, line, text) in _ARMS.items():
            rows = summary[(summary["arm"] == arm) & (summary["samples"] <= last)]
            axes.plot(rows["samples"], 100 * rows["error_m"], color=colour, linestyle=line, label=text)
            axes.fill_between(
                rows["samples"], 100 * rows["mean_low_m"], 100 * rows["mean_high_m"], color=colour,
                alpha=0.15, lw=0,
            )  # fmt: skip
        axes.set_xlabel("samples seen")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    zoomed.set_xlim(1, min(FEW, summary["samples"].max()))
    shown = summary[summary["samples"].between(1, FEW)]
    zoomed.set_ylim(max(0.0, 90 * shown["mean_low_m"].min()), 105 * shown["mean_high_m"].max())
    whole.set_ylim(bottom=0)
    whole.set_ylabel("distance between predicted and\ntrue rest point (cm)")
    whole.legend(loc="upper right")
    kind = STAND_IN if errors["stand_in"].all() else "recorded rigs"
    whole.set_title(f"(a) {rigs} rig{'s' * (rigs > 1)}; {kind}", loc="left", fontsize=8)
    zoomed.set_title("(b) the first samples", loc="left", fontsize=8)
    return Drawing(f"A2-{settings.domain}-exploration", figure, summary)
