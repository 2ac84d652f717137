"""F8 and F9 for three arms: error against samples on the diagnosed rig, and its place among conditions."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.error_curves import panel_title, summarise
from slapshot.latent_space import at_samples, fit_projection
from slapshot.plotting import STAND_IN, Drawing
from slapshot.retraining import ARMS

COLOURS = {"nominal": "#7F7F7F", "refitted": "#D55E00", "augmented": "#0072B2"}
LINES = {"nominal": ":", "refitted": "--", "augmented": "-"}
NAMES = {
    "nominal": "nominal",
    "refitted": "nominal, ranges refitted",
    "augmented": "with what was found, same ranges",
}
_PUCKS = {"red": "#D62728", "blue": "#1F4FB4"}
MODEL = 0  # one model is shown, because axes of different models are not comparable


def draw_errors(
    errors: Mapping[str, Mapping[str, pd.DataFrame]], floors: Mapping[str, float], stand_in: bool, name: str
) -> Drawing:
    """One panel per set of hits: error of each arm, with the noise floor from repeated commands."""
    figure, row = plt.subplots(1, len(errors), figsize=(4.2 * len(errors), 3.3), squeeze=False, sharey=True)
    tables = []
    for axes, letter, (hits, by_arm) in zip(row[0], "abc", errors.items(), strict=False):
        for arm in ARMS:
            summary = summarise(by_arm[arm], ["method"])
            _curve(axes, summary, arm)
            tables.append(summary.assign(arm=arm, hits=hits, noise_floor_m=floors[hits]))
        if np.isfinite(floors[hits]):
            axes.axhline(100 * floors[hits], color="black", lw=1, ls=(0, (1, 2)))
            axes.annotate(
                "noise floor (repeats)", (0.98, 100 * floors[hits]), xycoords=("axes fraction", "data"),
                ha="right", va="bottom", fontsize=7,
            )  # fmt: skip
        panel_title(axes, letter, hits)
        axes.set_ylim(bottom=0)
        axes.set_xlim(left=0)
    row[0][0].set_ylabel("error (cm)")
    row[0][0].legend(loc="upper right", handlelength=2.6)
    if stand_in:
        row[0][0].annotate(STAND_IN, (0.02, 0.03), xycoords="axes fraction", fontsize=7, color="#A00000")
    figure.supxlabel("samples seen")
    table = pd.concat(tables, ignore_index=True)
    first = ["hits", "arm", "method", "samples"]
    return Drawing(f"F8-{name}-arms", figure, table[[*first, *(c for c in table if c not in first)]])


def _curve(axes: Axes, summary: pd.DataFrame, arm: str) -> None:
    axes.plot(
        summary["samples"], 100 * summary["error_m"], color=COLOURS[arm], ls=LINES[arm], label=NAMES[arm]
    )
    low, high = 100 * summary["mean_low_m"].clip(lower=0), 100 * summary["mean_high_m"]
    axes.fill_between(summary["samples"], low, high, color=COLOURS[arm], alpha=0.15, lw=0)


def draw_latents(
    latents: Mapping[str, pd.DataFrame], samples: int, stand_in: bool, name: str
) -> tuple[Drawing, list[float]]:
    """One panel per arm: drawn conditions, and the recorded pucks for every random order of their hits.

    Returns:
        The figure, and for each arm the rms Mahalanobis distance of the recorded hidden states from the
        drawn ones in the plane of the two components; sqrt(2) is expected of another drawn condition.
    """
    figure, row = plt.subplots(1, len(ARMS), figsize=(3.6 * len(ARMS), 3.7), squeeze=False)
    tables, distances = [], []
    for axes, letter, arm in zip(row[0], "abc", ARMS, strict=True):
        table = latents[arm][latents[arm]["model"] == MODEL]
        projection = fit_projection(table)
        scores = projection.apply(np.stack(table["hidden"].to_list()))
        seen = at_samples(table.drop(columns="hidden").assign(pc1=scores[:, 0], pc2=scores[:, 1]), samples)
        cloud = seen[(seen["source"] == "simulated") & (seen["name"] == "") & seen["noise_variance"].notna()]
        recorded = seen[seen["source"] == "recorded"]
        axes.scatter(cloud["pc1"], cloud["pc2"], s=4, color="#C8C8C8", lw=0, label="drawn conditions")
        for puck, rows in recorded.groupby("object"):
            colour = _PUCKS.get(str(puck), "black")
            axes.scatter(
                rows["pc1"],
                rows["pc2"],
                s=30,
                marker="x",
                color=colour,
                lw=1.3,
                label=f"{puck} puck, recorded",
            )
        distances.append(_distance(cloud, recorded))
        panel_title(axes, letter, NAMES[arm])
        axes.set_xlabel(f"first component ({100 * projection.explained[0]:.0f} %)")
        axes.set_ylabel(f"second ({100 * projection.explained[1]:.0f} %)")
        axes.annotate(f"distance {distances[-1]:.1f}", (0.03, 0.03), xycoords="axes fraction", fontsize=8)
        tables.append(pd.concat([cloud, recorded]).assign(arm=arm))
    handles, labels = row[0][0].get_legend_handles_labels()
    title = f"recorded: {STAND_IN}" if stand_in else None
    figure.legend(handles, labels, loc="outside upper center", ncols=4, title=title, title_fontsize=7)
    columns = ["arm", "source", "object", "condition", "friction_x", "friction_y", "noise_variance", "repeat",
               "samples", "pc1", "pc2"]  # fmt: skip
    return Drawing(f"F9-{name}-arms", figure, pd.concat(tables)[columns]), distances


def _distance(cloud: pd.DataFrame, recorded: pd.DataFrame) -> float:
    points = cloud[["pc1", "pc2"]].to_numpy(float)
    apart = recorded[["pc1", "pc2"]].to_numpy(float) - points.mean(0)
    squares = (apart * np.linalg.solve(np.cov(points.T), apart.T).T).sum(1)
    return float(np.sqrt(squares.mean()))
