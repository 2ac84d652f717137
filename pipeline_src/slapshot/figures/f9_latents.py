"""F9: principal components of the hidden states, by condition and by samples seen (paper, figure 9)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.config.results import LatentsFigureSettings
from slapshot.latent_space import at_samples, fit_projection, read_latents
from slapshot.plotting import CONDITION_COLOURS, OTHER_COLOURS, STAND_IN, Drawing, method_name

SAMPLES = 20
MODEL = 0  # axes of different models are not comparable: one is shown
# Recorded pucks by their own colour.
_PUCKS = {"red": "#D62728", "blue": "#1F4FB4"}


Settings = LatentsFigureSettings


def draw(inputs: Mapping[str, Path], settings: LatentsFigureSettings) -> Drawing:
    """One row a method: (a) conditions and recorded pucks after 20 samples, (b) by samples seen."""
    methods = settings.methods
    figure, grid = plt.subplots(len(methods), 2, figsize=(9.6, 4.3 * len(methods)), squeeze=False)
    tables = []
    for row, method, letters in zip(grid, methods, ("ab", "cd", "ef"), strict=False):
        latents = read_latents(inputs[method])
        latents = latents[latents["model"] == MODEL]
        projection = fit_projection(latents)
        scores = projection.apply(np.stack(latents["hidden"].to_list()))
        latents = latents.drop(columns="hidden").assign(pc1=scores[:, 0], pc2=scores[:, 1])
        by_condition = _conditions(row[0], at_samples(latents, SAMPLES))
        by_samples = _samples(row[1], latents)
        seen = int(by_condition["samples"].iloc[0])
        row[0].set_title(f"({letters[0]}) {method_name(method)} after {seen} samples", loc="left")
        row[1].set_title(f"({letters[1]}) {method_name(method)} by samples seen", loc="left")
        share = 100 * projection.explained
        for axes in row:
            axes.set_xlabel(f"first component ({share[0]:.0f} % of the variance)")
            axes.set_ylabel(f"second component ({share[1]:.0f} %)")
        tables += [
            by_condition.assign(method=method, panel=letters[0]),
            by_samples.assign(method=method, panel=letters[1]),
        ]
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=4, markerscale=1.6, title=f"recorded: {STAND_IN}",
        title_fontsize=7,
    )  # fmt: skip
    table = pd.concat(tables, ignore_index=True)
    columns = ["method", "panel", "source", "recording", "rig", "object", "name", "condition", "friction_x",
               "friction_y", "noise_variance", "repeat", "samples", "pc1", "pc2"]  # fmt: skip
    return Drawing(f"F9-{settings.domain}-latents", figure, table[columns])


def _conditions(axes: Axes, seen: pd.DataFrame) -> pd.DataFrame:
    """Clusters of the named conditions and of the recorded pucks over the cloud of all conditions."""
    simulated = seen[(seen["source"] == "simulated") & seen["noise_variance"].notna()]
    cloud = simulated[simulated["name"] == ""]
    axes.scatter(cloud["pc1"], cloud["pc2"], s=3, color="#D5D5D5", label="drawn conditions", lw=0)
    shown = [cloud]
    names = [name for name in dict.fromkeys(simulated.sort_values("condition")["name"]) if name]
    for number, name in enumerate(names):
        rows = simulated[simulated["name"] == name]
        colour = CONDITION_COLOURS.get(name, OTHER_COLOURS[number % len(OTHER_COLOURS)])
        axes.scatter(rows["pc1"], rows["pc2"], s=14, color=colour, label=name, lw=0)
        shown.append(rows)
    recorded = seen[seen["source"] == "recorded"]
    # One point a puck of a rig: every repeat would bury the rest.
    keys = ["source", "recording", "rig", "object", "samples"]
    means = recorded.groupby(keys, as_index=False)[["pc1", "pc2"]].mean()
    for key, rows in means.groupby("object"):
        name = str(key)
        colour = _PUCKS.get(name, "black")
        axes.scatter(
            rows["pc1"], rows["pc2"], s=34, marker="x", color=colour, lw=1.4, label=f"{name} puck, recorded"
        )
        shown.append(rows)
    return pd.concat(shown, ignore_index=True)


def _samples(axes: Axes, latents: pd.DataFrame) -> pd.DataFrame:
    """The drawn conditions, coloured by how many samples the model has seen."""
    rows = latents[
        (latents["source"] == "simulated") & (latents["name"] == "") & latents["noise_variance"].notna()
    ]
    order = rows.sample(frac=1, random_state=0)  # so that no number of samples lies on top of the others
    points = axes.scatter(
        order["pc1"], order["pc2"], c=order["samples"], s=4, lw=0, cmap="viridis", rasterized=True
    )
    axes.figure.colorbar(points, ax=axes, label="samples seen")
    return rows
