"""F1: where the puck is expected to stop before and after adaptation (paper, figure 1)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from slapshot.config.results import FigureSettings
from slapshot.parquet import read_frame
from slapshot.plotting import METHOD_COLOURS, Drawing
from slapshot.scenes.scene import Scene

BEFORE_COLOUR = "#8A8A8A"
_ADAPTED = METHOD_COLOURS["kalman"]


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panels (a) before any sample, (b) after the most; one simulated hit, with 50 % and 90 % regions."""
    predictions = read_frame(inputs["predictions"] / "predictions.parquet")
    start = Scene.load(inputs["scene"]).info.start
    shown = _typical(predictions[predictions["source"] == "simulated"])
    most = shown["samples"].max()
    figure, panels = plt.subplots(2, 1, figsize=(6.4, 4.4), sharex=True, sharey=True)
    x, y = shown["true_x_m"].iloc[0], shown["true_y_m"].iloc[0]
    cases = ((0, "before any sample", BEFORE_COLOUR), (most, f"after {most} other hits", _ADAPTED))
    for axes, letter, (samples, title, colour) in zip(panels, "ab", cases, strict=True):
        row = shown[shown["samples"] == samples].iloc[0]
        for ellipse in region(row, colour):
            axes.add_patch(ellipse)
        axes.plot(row["x_m"], row["y_m"], "o", color=colour, ms=5, label="predicted")
        axes.plot(x, y, "x", color="#D62728", ms=8, mew=2, label="true rest point")
        axes.plot(*start, "o", color="black", ms=6, mfc="white", label="start")
        axes.annotate(
            "", (x, y), start, arrowprops={"arrowstyle": "-", "ls": ":", "color": "#AAAAAA", "shrinkA": 4}
        )
        axes.set_title(f"({letter}) {title}", loc="left")
        axes.set_aspect("equal")
        axes.set_ylabel("y (m)")
    panels[1].set_xlabel("x (m)")
    _limits(panels[0], shown, start)
    handles, labels = panels[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5)
    return Drawing(f"F1-{settings.domain}-intro", figure, shown.reset_index(drop=True))


def region(row: pd.Series, colour: str) -> list[Ellipse]:
    """The calibrated regions of a prediction, in m."""
    covariance = np.array([[row["cov_xx"], row["cov_xy"]], [row["cov_xy"], row["cov_yy"]]])
    variances, axes = np.linalg.eigh(covariance)
    angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    ellipses = []
    for column in sorted((str(c) for c in row.index if str(c).startswith("radius2_")), key=_level):
        width, height = 2 * np.sqrt(row[column] * variances[::-1])
        ellipses.append(
            Ellipse((row["x_m"], row["y_m"]), width, height, angle=angle, facecolor=colour, alpha=0.22,
                    edgecolor=colour, lw=1.0, label=f"{_level(column):g} % region")
        )  # fmt: skip
    return ellipses


def _level(column: str) -> float:
    return float(column.removeprefix("radius2_"))


def _typical(predictions: pd.DataFrame) -> pd.DataFrame:
    """All rows of the hit whose errors before and after adaptation are closest to the median.

    The best hit would be misleading.
    """
    off = np.hypot(predictions["x_m"] - predictions["true_x_m"], predictions["y_m"] - predictions["true_y_m"])
    keys = ["condition", "hit"]
    wide = predictions.assign(off=off).pivot(index=keys, columns="samples", values="off")
    features = wide[[wide.columns.min(), wide.columns.max()]]
    distance = ((features - features.median()) / features.std()).abs().sum(axis=1)
    condition, hit = distance.sort_values().index[0]
    return predictions[(predictions["condition"] == condition) & (predictions["hit"] == hit)]


def _limits(axes: Axes, shown: pd.DataFrame, start: tuple[float, ...]) -> None:
    """Room for the start, the truth and every region."""
    reach = np.sqrt(shown[[c for c in shown if str(c).startswith("radius2_")]].max(axis=1))
    xs, ys = [start[0], *shown["true_x_m"]], [start[1], *shown["true_y_m"]]
    for centre, variance, ends in (("x_m", "cov_xx", xs), ("y_m", "cov_yy", ys)):
        half = reach * np.sqrt(shown[variance])
        ends += [(shown[centre] - half).min(), (shown[centre] + half).max()]
    axes.set_xlim(min(xs) - 0.1, max(xs) + 0.1)
    axes.set_ylim(min(ys) - 0.1, max(ys) + 0.1)
