"""F8: error against samples on recordings: all, the first samples, by object (paper, figure 8)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

from slapshot.config.results import FigureSettings
from slapshot.error_curves import draw_curves, panel_title, summarise
from slapshot.parquet import read_frame
from slapshot.plotting import STAND_IN, Drawing

FEW = 12


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panels (a) all objects, (b) few samples, (c) each object, one row a recording.

    Bands are 95 % intervals of the mean over rigs, or over models where there is one rig.
    """
    parts = []
    for role, folder in inputs.items():
        parts.append(read_frame(folder / "errors.parquet").assign(recording=role.split("/")[1]))
    errors = pd.concat(parts, ignore_index=True)
    recordings = list(dict.fromkeys(errors["recording"]))
    most = errors.groupby("recording")["object"].nunique().max()
    figure, grid = plt.subplots(
        len(recordings), 2 + most, figsize=(2.7 * (2 + most), 3.1 * len(recordings)), squeeze=False
    )
    tables = []
    for row, recording in zip(grid, recordings, strict=True):
        own = errors[errors["recording"] == recording]
        rigs = own["rig"].nunique()
        unit = "rig" if rigs > 1 else "model"
        overall = summarise(own, ["method"], unit)
        by_object = summarise(own, ["method", "object"], unit)
        top = 120 * by_object["error_m"].max()
        stand_in = own["stand_in"].any()
        kind = STAND_IN if stand_in else "real recording"
        draw_curves(row[0], overall, band="mean")
        panel_title(row[0], "a", "all pucks")
        row[0].legend(loc="upper right", handlelength=2.6)
        row[0].set_ylabel(f"recording “{recording}”, {rigs} rig{'s' * (rigs > 1)}\nerror (cm)")
        row[0].annotate(kind, (0.02, 0.03), xycoords="axes fraction", fontsize=7, color="#A00000")
        draw_curves(row[1], overall, FEW, band="mean", label=False)
        panel_title(row[1], "b", f"first {FEW} samples")
        objects = list(dict.fromkeys(own["object"]))
        for axes, name in zip(row[2:], objects, strict=False):
            draw_curves(axes, by_object[by_object["object"] == name], FEW, band="mean", label=False)
            axes.set_title(("(c) " if name == objects[0] else "") + f"{name} puck", loc="left")
        for axes in row:
            axes.set_ylim(0, top)
        for axes in row[2 + len(objects) :]:
            axes.set_visible(False)
        tables += [
            overall.assign(recording=recording, panel="a, b", stand_in=stand_in),
            by_object.assign(recording=recording, panel="c", stand_in=stand_in),
        ]
    figure.supxlabel("samples seen")
    table = pd.concat(tables, ignore_index=True)
    first_columns = ["recording", "stand_in", "panel", "method", "object", "samples"]
    table = table[[*first_columns, *(c for c in table if c not in first_columns)]]
    return Drawing(f"F8-{settings.domain}-recorded", figure, table)
