"""U2: normalised innovations of the filter, in simulation and on recordings."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.config.results import FigureSettings
from slapshot.parquet import read_frame
from slapshot.plotting import METHOD_COLOURS, STAND_IN, Drawing

_SIMULATED, _RECORDED = "#8A8A8A", METHOD_COLOURS["kalman"]
QUANTILE = 0.95
_CELL = 0.15  # m, of the map
_FEWEST = 8  # samples in a cell that is shown


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panels (a) NIS by samples seen, (b) share beyond the simulated 95 %, (c) where on the board."""
    innovations = read_frame(inputs["beliefs"] / "innovations.parquet")
    drawn = (innovations["source"] == "simulated") & (innovations["name"] == "")
    simulated = innovations[drawn & innovations["noise_variance"].isna()]
    recorded = innovations[innovations["source"] == "recorded"]
    limit = simulated.groupby(["model", "samples"])["nis"].quantile(QUANTILE).rename("limit")
    recorded = recorded.join(limit, on=["model", "samples"])
    recorded = recorded.assign(beyond=recorded["nis"] > recorded["limit"])
    bands = pd.concat([_quantiles(simulated), _quantiles(recorded)], ignore_index=True)
    rigs = recorded.groupby(["recording", "rig", "object"])["beyond"].mean().reset_index()
    cells = _cells(recorded)

    figure, (a, b, c) = plt.subplots(1, 3, figsize=(10.2, 3.5), width_ratios=[1.2, 0.8, 1.3])
    _bands(a, bands)
    _rigs(b, rigs)
    points = c.scatter(
        cells["x_m"], cells["y_m"], c=100 * cells["beyond"], s=6 + 1.2 * np.sqrt(cells["n"]), cmap="viridis",
        vmin=0, marker="s",
    )  # fmt: skip
    figure.colorbar(points, ax=c, label=f"% beyond the simulated {100 * QUANTILE:.0f} %")
    c.set_aspect("equal")
    c.set_xlabel("rest point x (m)")
    c.set_ylabel("y (m)")
    c.set_title("(c) where recorded hits surprise", loc="left")
    table = pd.concat(
        [bands.assign(panel="a"), rigs.assign(panel="b"), cells.assign(panel="c")], ignore_index=True
    )
    return Drawing(f"U2-{settings.domain}-innovations", figure, table)


def _quantiles(rows: pd.DataFrame) -> pd.DataFrame:
    """Median, 5 % and 95 % of the NIS by samples seen."""
    grouped = rows.groupby(["source", "samples"])["nis"]
    quantiles = {f"nis_{round(100 * q)}": grouped.quantile(q) for q in (0.05, 0.5, 0.95)}
    return pd.DataFrame(quantiles).reset_index()


def _bands(axes: Axes, bands: pd.DataFrame) -> None:
    for source, colour in (("simulated", _SIMULATED), ("recorded", _RECORDED)):
        rows = bands[bands["source"] == source]
        axes.plot(rows["samples"], rows["nis_50"], color=colour, label=f"{source}, median")
        axes.plot(rows["samples"], rows["nis_95"], color=colour, ls="--", lw=1.2, label=f"{source}, 95 %")
        axes.fill_between(rows["samples"], rows["nis_5"], rows["nis_95"], color=colour, alpha=0.12, lw=0)
    axes.set_yscale("log")
    axes.set_xlim(left=0)
    axes.set_xlabel("samples seen before")
    axes.set_ylabel("normalised innovation squared")
    axes.set_title("(a) surprise of each sample", loc="left")
    axes.legend(loc="lower right", fontsize=7)
    axes.annotate(f"recorded: {STAND_IN}", (0.02, 0.97), xycoords="axes fraction", fontsize=6.5,
                  color="#A00000", va="top")  # fmt: skip


def _rigs(axes: Axes, rigs: pd.DataFrame) -> None:
    """One point for each puck of a rig, and the simulated reference."""
    order = sorted(rigs["object"].unique())
    spread = np.random.default_rng(0)
    for i, name in enumerate(order):
        rows = rigs[rigs["object"] == name]
        axes.plot(i + spread.uniform(-0.15, 0.15, len(rows)), 100 * rows["beyond"], "o", ms=4, alpha=0.7,
                  color={"red": "#D62728", "blue": "#1F4FB4"}.get(name, "black"))  # fmt: skip
    axes.axhline(100 * (1 - QUANTILE), color="black", ls=":", lw=1)
    axes.annotate("simulated", (0.98, 100 * (1 - QUANTILE)), xycoords=("axes fraction", "data"), fontsize=7,
                  ha="right", va="bottom")  # fmt: skip
    axes.set_xticks(range(len(order)), [f"{name} puck" for name in order])
    axes.set_xlim(-0.6, len(order) - 0.4)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"% of samples beyond the simulated {100 * QUANTILE:.0f} %")
    axes.set_title("(b) each rig", loc="left")


def _cells(recorded: pd.DataFrame) -> pd.DataFrame:
    """Share of surprising samples by where they came to rest, in square cells."""
    cells = recorded.assign(
        x_m=(recorded["x_m"] / _CELL).round() * _CELL, y_m=(recorded["y_m"] / _CELL).round() * _CELL
    )
    table = cells.groupby(["x_m", "y_m"], as_index=False).agg(beyond=("beyond", "mean"), n=("nis", "size"))
    return table[table["n"] >= _FEWEST]
