"""F4: error against samples in FetchSlide, by friction and by noise (paper, figure 4)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D

from slapshot.config.results import FigureSettings
from slapshot.error_curves import panel_title, summarise
from slapshot.parquet import read_frame
from slapshot.plotting import CONDITION_COLOURS, FRICTIONS, Drawing, method_line, method_name


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panel (a): the named conditions, all levels of noise; (b): all test conditions, each level of noise.

    A colour is a condition or a level of noise (more noise is darker), a line style a method: each panel
    holds all of them, as in the paper.
    """
    errors = pd.concat([read_frame(f / "errors.parquet") for f in inputs.values()], ignore_index=True)
    friction = summarise(errors[errors["name"].isin(FRICTIONS)], ["method", "name"])
    noise = summarise(errors[errors["name"] == ""], ["method", "noise_variance", "noise_sd_m"])
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 3.9), squeeze=False)
    left, right = panels[0]
    _curves(left, [(name, CONDITION_COLOURS[name], friction[friction["name"] == name]) for name in FRICTIONS])
    panel_title(left, "a", "by friction, all levels of noise")
    levels = noise[["noise_variance", "noise_sd_m"]].drop_duplicates().sort_values("noise_variance")
    darker = plt.colormaps["YlOrBr"](np.linspace(0.4, 0.95, len(levels)))
    cases = []
    for (variance, sd), colour in zip(levels.itertuples(index=False), darker, strict=True):
        title = f"noise variance {variance:g} (sd {100 * sd:.1f} cm)"
        cases.append((title, to_hex(colour), noise[noise["noise_variance"] == variance]))
    _curves(right, cases)
    panel_title(right, "b", "by noise, all test conditions")
    methods = list(dict.fromkeys(errors["method"]))
    lines = [Line2D([], [], color="black", linestyle=method_line(m)) for m in methods]
    figure.legend(
        lines, [method_name(m) for m in methods], loc="outside upper center", ncols=len(methods),
        handlelength=3,
    )  # fmt: skip
    left.set_ylabel("distance between predicted and true rest point (cm)")
    table = pd.concat(
        [friction.assign(panel="a").rename(columns={"name": "condition"}), noise.assign(panel="b")],
        ignore_index=True,
    )
    first = ["panel", "method", "condition", "noise_variance", "noise_sd_m", "samples"]
    return Drawing(
        f"F4-{settings.domain}-errors", figure, table[[*first, *(c for c in table if c not in first)]]
    )


def _curves(axes: Axes, cases: list[tuple[str, str, pd.DataFrame]]) -> None:
    """Each case's title, colour and rows of a summary; a line style for each method; 95 % bands."""
    for title, colour, summary in cases:
        for i, (method, rows) in enumerate(summary.groupby("method", sort=False)):
            axes.plot(
                rows["samples"],
                100 * rows["error_m"],
                color=colour,
                linestyle=method_line(str(method)),
                label=title if i == 0 else None,
            )
            axes.fill_between(
                rows["samples"],
                100 * rows["mean_low_m"].clip(lower=0),
                100 * rows["mean_high_m"],
                color=colour,
                alpha=0.15,
                lw=0,
            )
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_xlabel("samples seen")
    axes.legend(loc="upper right")
