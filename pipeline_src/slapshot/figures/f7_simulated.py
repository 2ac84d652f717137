"""F7: error against samples in simulation: all conditions, by friction, by noise (paper, figure 7)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd

from slapshot.figures.curves import draw_curves, panel_title, summarise
from slapshot.figures.drawing import Drawing

FRICTIONS = ("low friction", "medium friction", "high friction")
LOW_SAMPLES = 8


def draw(inputs: Mapping[str, Path], config: Mapping[str, Any]) -> Drawing:
    """Panels (a) over all test conditions and noise levels, (b) by friction, (c) by noise."""
    errors = pd.concat([pd.read_parquet(f / "errors.parquet") for f in inputs.values()], ignore_index=True)
    drawn = errors[errors["name"] == ""]
    overall = summarise(drawn, ["method"])
    friction = summarise(errors[errors["name"].isin(FRICTIONS)], ["method", "name"])
    noise = summarise(drawn, ["method", "noise_variance", "noise_sd_m"])

    figure = plt.figure(figsize=(9.6, 6.2))
    grid = figure.add_gridspec(2, 12)
    first = figure.add_subplot(grid[0, :5])
    draw_curves(first, overall)
    panel_title(first, "a", "all test conditions and noise levels")
    first.legend(loc="upper right")
    top = 100 * (friction["error_m"] + friction["sd_m"]).max()
    shown = [name for name in FRICTIONS if (friction["name"] == name).any()]
    for i, name in enumerate(shown):
        axes = figure.add_subplot(grid[0, 6 + 2 * i : 8 + 2 * i])
        draw_curves(axes, friction[friction["name"] == name], LOW_SAMPLES, label=False)
        axes.set_ylim(0, top)
        axes.set_title(("(b) " if i == 0 else "") + name.removesuffix(" friction"), loc="left")
        if i:
            axes.tick_params(labelleft=False)
        else:
            axes.text(0, 1.12, "by isotropic friction, few samples", transform=axes.transAxes)
    levels = noise[["noise_variance", "noise_sd_m"]].drop_duplicates().sort_values("noise_variance")
    top = 100 * (noise["error_m"] + noise["sd_m"]).max()
    width = 12 // len(levels)
    for i, level in enumerate(levels.itertuples()):
        axes = figure.add_subplot(grid[1, width * i : width * (i + 1)])
        draw_curves(axes, noise[noise["noise_variance"] == level.noise_variance], label=False)
        axes.set_ylim(0, top)
        text = f"noise variance {level.noise_variance:g} (sd {100 * level.noise_sd_m:.0f} cm)"
        axes.set_title(("(c) " if i == 0 else "") + text, loc="left")
    figure.supxlabel("samples seen")
    figure.supylabel("distance between predicted and true rest point (cm)")
    table = pd.concat(
        [
            overall.assign(panel="a"),
            friction.assign(panel="b").rename(columns={"name": "condition"}),
            noise.assign(panel="c"),
        ],
        ignore_index=True,
    )
    first_columns = ["panel", "method", "condition", "noise_variance", "noise_sd_m", "samples"]
    table = table[[*first_columns, *(c for c in table if c not in first_columns)]]
    return Drawing(f"F7-{config['domain']}-simulated", figure, table)
