"""U1: coverage of prediction regions from sampled phi, raw and calibrated."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.config.results import FigureSettings
from slapshot.parquet import read_frame
from slapshot.plotting import METHOD_COLOURS, STAND_IN, Drawing

_KINDS = {"raw": "#8A8A8A", "calibrated": METHOD_COLOURS["kalman"]}
_NOISE_COLOURS = ("#56B4E9", "#E69F00", "#D55E00", "#CC79A7")


def draw(inputs: Mapping[str, Path], settings: FigureSettings) -> Drawing:
    """Panels (a) test conditions with the noise of training, (b) by noise, (c) recordings, (d) areas."""
    coverage = read_frame(inputs["calibrate"] / "coverage.parquet")
    keys = ["level", "kind", "samples"]
    trained = _over_models(coverage[coverage["noise_variance"].isna()], keys)
    by_noise = _over_models(coverage[coverage["kind"] == "calibrated"].dropna(), ["noise_variance", *keys])
    recorded = _recorded(read_frame(inputs["predictions"] / "predictions.parquet"))
    levels = sorted(coverage["level"].unique())
    figure, ((a, b), (c, d)) = plt.subplots(2, 2, figsize=(9.6, 6.2))
    for kind, colour in _KINDS.items():
        for level in levels:
            rows = trained[(trained["kind"] == kind) & (trained["level"] == level)]
            label = kind if level == levels[0] else None
            _line(a, rows, colour, label)
    _nominal(a, levels)
    a.legend(loc="upper right", bbox_to_anchor=(1.0, 0.88))
    a.set_title("(a) simulated, noise as in training", loc="left")
    for (variance, rows), colour in zip(by_noise.groupby("noise_variance"), _NOISE_COLOURS, strict=False):
        for level in levels:
            label = f"noise variance {variance:g}" if level == levels[0] else None
            _line(b, rows[rows["level"] == level], colour, label)
    _nominal(b, levels)
    b.legend(loc="upper right", bbox_to_anchor=(1.0, 0.88))
    b.set_title("(b) simulated, calibrated, by noise", loc="left")
    for level in levels:
        _line(c, recorded[recorded["level"] == level], _KINDS["calibrated"], None)
    _nominal(c, levels)
    c.set_title("(c) recorded, calibrated in simulation", loc="left")
    c.annotate(STAND_IN, (0.02, 0.03), xycoords="axes fraction", fontsize=7, color="#A00000")
    for kind, colour in _KINDS.items():
        rows = trained[(trained["kind"] == kind) & (trained["level"] == levels[-1])]
        d.plot(rows["samples"], 1e4 * rows["area_m2"], "o-", ms=3, color=colour, label=kind)
    d.set_yscale("log")
    d.set_ylabel("area (cm²)")
    d.set_title(f"(d) median area of the {100 * levels[-1]:g} % region", loc="left")
    d.legend()
    for axes in (a, b, c):
        axes.set_ylim(0, 1)
        axes.set_ylabel("share of rest points inside")
    for axes in (a, b, c, d):
        axes.set_xlabel("samples seen")
        axes.set_xlim(left=0)
    table = pd.concat(
        [trained.assign(panel="a, d"), by_noise.assign(panel="b"), recorded.assign(panel="c")],
        ignore_index=True,
    )
    first = ["panel", "level", "kind", "noise_variance", "samples", "coverage", "low", "high"]
    return Drawing(f"U1-{settings.domain}-coverage", figure, table[[*first, "area_m2"]])


def _over_models(coverage: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Mean over models, with their range."""
    grouped = coverage.groupby(keys, as_index=False)
    return grouped.agg(
        coverage=("coverage", "mean"),
        low=("coverage", "min"),
        high=("coverage", "max"),
        area_m2=("area_m2", "mean"),
    )


def _recorded(predictions: pd.DataFrame) -> pd.DataFrame:
    """Coverage of the calibrated regions on recordings, with a 95 % interval over rigs."""
    rows = predictions[predictions["source"] == "recorded"]
    dx, dy = rows["true_x_m"] - rows["x_m"], rows["true_y_m"] - rows["y_m"]
    determinant = rows["cov_xx"] * rows["cov_yy"] - rows["cov_xy"] ** 2
    distance = (dx**2 * rows["cov_yy"] - 2 * dx * dy * rows["cov_xy"] + dy**2 * rows["cov_xx"]) / determinant
    tables = []
    for column in (str(c) for c in rows if str(c).startswith("radius2_")):
        inside = rows.assign(inside=distance <= rows[column])
        per_rig = inside.groupby(["samples", "recording", "rig"])["inside"].mean().groupby("samples")
        mean, sd, count = (per_rig.agg(what) for what in ("mean", "std", "size"))
        half = 1.96 * sd / np.sqrt(count)
        level = float(column.removeprefix("radius2_")) / 100
        values = {"coverage": mean, "low": mean - half, "high": mean + half}
        tables.append(pd.DataFrame(values).reset_index().assign(level=level, kind="calibrated"))
    return pd.concat(tables, ignore_index=True)


def _line(axes: Axes, rows: pd.DataFrame, colour: str, label: str | None) -> None:
    axes.plot(rows["samples"], rows["coverage"], "o-", ms=3, color=colour, label=label)
    axes.fill_between(rows["samples"], rows["low"], rows["high"], color=colour, alpha=0.15, lw=0)


def _nominal(axes: Axes, levels: list[float]) -> None:
    for level in levels:
        axes.axhline(level, color="black", lw=0.8, ls=":")
        axes.annotate(f"{100 * level:g} %", (1.0, level), xycoords=("axes fraction", "data"), fontsize=7,
                      ha="right", va="bottom")  # fmt: skip
