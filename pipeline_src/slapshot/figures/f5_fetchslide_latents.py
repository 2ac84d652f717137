"""F5: principal components of the hidden states in FetchSlide, by friction and samples (paper, figure 5)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.config.results import LatentsFigureSettings
from slapshot.latent_space import fit_projection, read_latents
from slapshot.plotting import CONDITION_COLOURS, FRICTIONS, Drawing, method_name

MODEL = 0  # axes of different models are not comparable: one is shown


Settings = LatentsFigureSettings


def draw(inputs: Mapping[str, Path], settings: LatentsFigureSettings) -> Drawing:
    """One row a method: the named conditions after all numbers of samples, by friction and by that number."""
    methods = settings.methods
    figure, grid = plt.subplots(len(methods), 2, figsize=(9.6, 4.0 * len(methods)), squeeze=False)
    tables = []
    for row, method, letters in zip(grid, methods, ("ab", "cd", "ef"), strict=False):
        latents = read_latents(inputs[method])
        latents = latents[latents["model"] == MODEL]
        projection = fit_projection(latents)
        named = latents[latents["name"].isin(FRICTIONS) & latents["noise_variance"].notna()]
        scores = projection.apply(np.stack(named["hidden"].to_list()))
        shown = named.drop(columns="hidden").assign(pc1=scores[:, 0], pc2=scores[:, 1])
        _by_friction(row[0], shown)
        _by_samples(row[1], shown)
        share = 100 * projection.explained
        for axes, letter, what in zip(row, letters, ("friction", "samples seen"), strict=True):
            axes.set_title(f"({letter}) {method_name(method)} by {what}", loc="left")
            axes.set_xlabel(f"first component ({share[0]:.0f} % of the variance)")
            axes.set_ylabel(f"second component ({share[1]:.0f} %)")
        tables.append(shown.assign(method=method))
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(FRICTIONS), markerscale=2.5)
    table = pd.concat(tables, ignore_index=True)
    columns = [
        "method",
        "name",
        "condition",
        "friction_x",
        "noise_variance",
        "repeat",
        "samples",
        "pc1",
        "pc2",
    ]
    return Drawing(f"F5-{settings.domain}-latents", figure, table[columns])


def _by_friction(axes: Axes, shown: pd.DataFrame) -> None:
    for name in FRICTIONS:
        rows = shown[shown["name"] == name]
        axes.scatter(
            rows["pc1"], rows["pc2"], s=7, color=CONDITION_COLOURS[name], label=name, lw=0, alpha=0.8
        )


def _by_samples(axes: Axes, shown: pd.DataFrame) -> None:
    order = shown.sample(frac=1, random_state=0)  # so that no number of samples lies on top of the others
    points = axes.scatter(order["pc1"], order["pc2"], c=order["samples"], s=7, lw=0, cmap="viridis")
    axes.figure.colorbar(points, ax=axes, label="samples seen")
