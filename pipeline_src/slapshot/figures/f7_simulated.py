"""F7: error against samples in simulation: all conditions, by friction, by noise (paper, figure 7)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import SubFigure

from slapshot.config.results import FigureSettings
from slapshot.error_curves import draw_curves, panel_title, summarise
from slapshot.parquet import read_frame
from slapshot.plotting import FRICTIONS, Drawing

LOW_SAMPLES = 12
_SHADED = ("kalman", "lstm")  # five bands on top of each other would hide one another


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panels (a) over all test conditions and noise levels, (b) by friction, (c) by noise."""
    errors = pd.concat([read_frame(f / "errors.parquet") for f in inputs.values()], ignore_index=True)
    drawn = errors[errors["name"] == ""]
    overall = summarise(drawn, ["method"])
    friction = summarise(errors[errors["name"].isin(FRICTIONS)], ["method", "name"])
    noise = summarise(drawn, ["method", "noise_variance", "noise_sd_m"])

    figure = plt.figure(figsize=(9.6, 6.4))
    rows = figure.subfigures(2, 1, squeeze=False)[:, 0]
    left, right = rows[0].subfigures(1, 2, width_ratios=[1, 1.35], squeeze=False)[0]
    axes = left.subplots()
    shaded = overall["method"].isin(_SHADED)
    draw_curves(axes, overall[shaded], band="sd")
    draw_curves(axes, overall[~shaded])
    panel_title(axes, "a", "all test conditions and noise levels")
    axes.legend(loc="upper right", handlelength=2.6)
    shown = [name for name in FRICTIONS if (friction["name"] == name).any()]
    if shown:
        _row(right, "b", friction, [(name, friction["name"] == name) for name in shown], LOW_SAMPLES)
    levels = noise[["noise_variance", "noise_sd_m"]].drop_duplicates().sort_values("noise_variance")
    _row(
        rows[1],
        "c",
        noise,
        [
            (f"noise variance {v:g} (sd {100 * sd:.0f} cm)", noise["noise_variance"] == v)
            for v, sd in levels.itertuples(index=False)
        ],
        None,
    )
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
    return Drawing(f"F7-{settings.domain}-simulated", figure, table)


def _row(
    figure: SubFigure,
    letter: str,
    summary: pd.DataFrame,
    cases: list[tuple[str, pd.Series]],
    last: int | None,
) -> None:
    """Panels with one scale, a case each: its title and which rows of the summary it shows."""
    top = 110 * summary["error_m"].max()
    panels = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
    for i, (axes, (title, rows)) in enumerate(zip(panels, cases, strict=True)):
        draw_curves(axes, summary[rows], last, band="mean", label=False)
        axes.set_ylim(0, top)
        axes.set_title(f"({letter}) {title}" if i == 0 else title, loc="left")
