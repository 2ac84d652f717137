"""F3: belief over phi and over y after 0, 2 and 10 samples of a line (paper, figure 3)."""

from collections.abc import Mapping
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from matplotlib.ticker import MaxNLocator

from slapshot.config.results import FigureSettings
from slapshot.error_curves import panel_title
from slapshot.errors import InputError
from slapshot.parquet import read_frame
from slapshot.plotting import METHOD_COLOURS, OTHER_COLOURS, Drawing

_KALMAN, _TRUE = METHOD_COLOURS["kalman"], OTHER_COLOURS[0]
_PRIOR = "#9A9A9A"
_REACH = 2.3  # standard deviations of the widest belief that the axes of phi show


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """A row for each number of samples: left the belief over phi, right the one over y."""
    tables = {
        name: read_frame(inputs["regression"] / f"{name}.parquet")
        for name in ("belief", "prediction", "observed")
    }
    belief, prediction, observed = tables.values()
    if "mean_2" not in belief:
        raise InputError("F3 draws phi as ellipses; set regression.kalman.latent to 2")
    counts = belief["samples"].tolist()
    figure, axes = plt.subplots(
        len(counts), 2, figsize=(7.6, 2.5 * len(counts) + 0.5), width_ratios=[1, 1.75], squeeze=False,
        sharex="col", sharey="col",
    )  # fmt: skip
    for row, (n, (left, right)) in enumerate(zip(counts, axes, strict=True)):
        seen = "no samples" if n == 0 else f"{n} samples"
        draw_phi(left, belief, n)
        panel_title(left, ascii_lowercase[2 * row], rf"belief over $\phi$, {seen}")
        draw_y(right, prediction[prediction["samples"] == n], observed[observed["sample"] <= n])
        panel_title(right, ascii_lowercase[2 * row + 1], f"belief over y, {seen}")
        left.set_box_aspect(1)
        left.set_ylabel(r"$\phi_2$")
        right.set_ylabel("y")
    _limit(axes[0], belief, prediction, observed)
    axes[-1, 0].set_xlabel(r"$\phi_1$")
    axes[-1, 1].set_xlabel("x")
    # The last row shows everything that any row shows.
    handles = [entry for panel in axes[-1, ::-1] for entry in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    table = pd.concat([part.assign(shown=name) for name, part in tables.items()], ignore_index=True)
    return Drawing(
        "F3-linear-regression", figure, table[["shown", *(c for c in table.columns if c != "shown")]]
    )


def draw_phi(axes: Axes, belief: pd.DataFrame, samples: int) -> None:
    """The belief about (phi_1, phi_2) as ellipses of 1 and 2 standard deviations, the prior faint behind."""
    for row in _rows(belief, 0) if samples else []:
        for sd in (1, 2):
            label = "learned prior, 1 and 2 sd" if sd == 1 else None
            axes.add_patch(_ellipse(row, sd, fill=False, edgecolor=_PRIOR, lw=1, ls=(0, (4, 3)), label=label))
    for row in _rows(belief, samples):
        for sd, alpha in ((2, 0.18), (1, 0.35)):
            label = r"belief over $\phi$, 1 and 2 sd" if sd == 1 else None
            axes.add_patch(_ellipse(row, sd, facecolor=_KALMAN, alpha=alpha, lw=0, label=label))
            axes.add_patch(_ellipse(row, sd, fill=False, edgecolor=_KALMAN, lw=1))
        axes.plot(row.mean_1, row.mean_2, "o", ms=3, color=_KALMAN)


def _rows(belief: pd.DataFrame, samples: int) -> list[Any]:
    return list(belief[belief["samples"] == samples].itertuples())


def _ellipse(row: Any, sd: float, **style: Any) -> Ellipse:
    """Contour of the Gaussian at `sd` standard deviations."""
    covariance = [
        [row.covariance_1_1, row.covariance_1_2],
        [row.covariance_1_2, row.covariance_2_2],
    ]
    variances, directions = np.linalg.eigh(covariance)
    width, height = 2 * sd * np.sqrt(variances)
    angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
    return Ellipse((row.mean_1, row.mean_2), width, height, angle=angle, **style)


def draw_y(axes: Axes, prediction: pd.DataFrame, observed: pd.DataFrame) -> None:
    """Mean and one-sd band of y, the exact ones dashed, the true line, and the samples seen so far."""
    x, mean, sd = (prediction[name] for name in ("x", "mean_y", "sd_y"))
    # In the legend's order; zorder is that of the picture.
    axes.plot(x, prediction["true_y"], color=_TRUE, label="true line")
    axes.plot(
        observed["x"], observed["observed_y"], "o", ms=4.5, color="black", mec="white", mew=0.7,
        label="noisy samples", zorder=4,
    )  # fmt: skip
    for sign in (0, -1, 1):
        label = None if sign else "exact posterior, mean and one sd"
        exact = prediction["exact_mean_y"] + sign * prediction["exact_sd_y"]
        axes.plot(x, exact, color="black", lw=0.9, ls=(0, (5, 3)), label=label, zorder=3)
    axes.plot(x, mean, color=_KALMAN, label=r"Kalman, at the mean of $\phi$")
    label = r"Kalman, one sd over sampled $\phi$"
    axes.fill_between(x, mean - sd, mean + sd, color=_KALMAN, alpha=0.2, lw=0, label=label)


def _limit(axes: Any, belief: pd.DataFrame, prediction: pd.DataFrame, observed: pd.DataFrame) -> None:
    """One pair of limits a column: all beliefs over phi with equal scales, all bands and samples of y."""
    phi, y = axes
    centre = belief[["mean_1", "mean_2"]].to_numpy()
    reach = _REACH * np.sqrt(belief[["covariance_1_1", "covariance_2_2"]].to_numpy())
    low, high = (centre - reach).min(0), (centre + reach).max(0)
    half = (high - low).max() / 2
    for limit, middle in zip((phi.set_xlim, phi.set_ylim), (low + high) / 2, strict=True):
        limit(middle - half, middle + half)
    for axis in (phi.xaxis, phi.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=True))
    y.set_xlim(prediction["x"].min(), prediction["x"].max())
    bands = (("mean_y", "sd_y"), ("exact_mean_y", "exact_sd_y"))
    shown = [prediction[mean] + sign * prediction[sd] for mean, sd in bands for sign in (-1, 1)]
    values = pd.concat([*shown, observed["observed_y"]])
    margin = 0.04 * (values.max() - values.min())
    y.set_ylim(values.min() - margin, values.max() + margin)
