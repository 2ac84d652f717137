"""M1: loss curves and sizes of all methods."""

import json
from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

from slapshot.config.results import FigureSettings
from slapshot.plotting import Drawing, method_colour, method_line, method_name


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panels (a) validation loss of the models during training, (b) trained parameters of one model."""
    figure, (curves, sizes) = plt.subplots(1, 2, figsize=(9.6, 3.4), width_ratios=[1.7, 1])
    tables = []
    for method, folder in inputs.items():
        losses = pd.read_csv(folder / "losses.csv")
        described = json.loads((folder / "ensemble.json").read_text())
        by_step = losses.groupby("step")["validation"]
        colour = method_colour(method)
        curves.plot(by_step.mean(), color=colour, linestyle=method_line(method), label=method_name(method))
        curves.fill_between(by_step.min().index, by_step.min(), by_step.max(), color=colour, alpha=0.08, lw=0)
        sizes.barh(method_name(method), described["parameters_per_model"] / 1000, color=colour)
        tables.append(losses.assign(method=method, parameters=described["parameters_per_model"]))
    curves.set_yscale("log")
    curves.set_xlim(left=0)
    curves.set_xlabel("training step")
    curves.set_ylabel("validation loss (standardised)")
    curves.set_title("(a) loss over the sequence, mean and range of the models", loc="left")
    curves.legend(handlelength=2.6)
    sizes.invert_yaxis()
    sizes.grid(axis="y", visible=False)
    sizes.set_xlabel("thousand parameters")
    sizes.set_title("(b) size of one model", loc="left")
    table = pd.concat(tables, ignore_index=True)
    first = ["method", "parameters", "model", "step"]
    return Drawing(f"M1-{settings.domain}-training", figure, table[[*first, "train", "validation"]])
