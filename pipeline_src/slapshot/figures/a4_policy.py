"""A4: distance to targets for policy adaptation and for adapted models, against hits (paper, C6 and S4)."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes

from slapshot.config.results import PolicyFigureSettings
from slapshot.error_curves import summarise
from slapshot.parquet import read_frame
from slapshot.plotting import STAND_IN, Drawing, method_colour, method_line, method_name

POLICY, PREDICTED = "policy", "predicted"


Settings = PolicyFigureSettings


def draw(inputs: Mapping[str, Path], settings: PolicyFigureSettings) -> Drawing:
    """Panels (a) distance to targets of all methods; (b) policy hits and predictions, as in the paper.

    Bars are 95 % intervals over rigs. Models act by gradient.
    """
    hit = pd.concat(_hits(inputs), ignore_index=True)
    method = settings.method
    errors = read_frame(inputs["predicted"] / "errors.parquet").assign(method=PREDICTED)
    places = {n: i for i, n in enumerate(sorted(hit.loc[hit["samples"] >= 0, "samples"].unique()))}
    predicted = errors[errors["samples"].isin(places)]
    summary, beside = summarise(hit, ["method"], "rig"), summarise(predicted, ["method"], "rig")
    figure, (acts, predicts) = plt.subplots(1, 2, figsize=(9.6, 3.9), sharey=True)
    methods = [m for m in dict.fromkeys(hit["method"]) if m]
    for number, name in enumerate(methods):
        rows = summary[summary["method"] == name]
        _bars(acts, rows, places, 0.08 * (number - 1), method_name(name), name)
    floor = summary[summary["method"] == ""].iloc[0]
    acts.axhspan(100 * floor["mean_low_m"], 100 * floor["mean_high_m"], color="#DDDDDD", lw=0)
    acts.axhline(
        100 * floor["error_m"], color="#555555", lw=1, label="oracle: repeats a command that leads there"
    )
    _bars(
        predicts, summary[summary["method"] == POLICY], places, 0.04, "policy adaptation hits targets", POLICY
    )
    _bars(predicts, beside, places, -0.04, f"{method_name(method)} predicts recorded hits", method)
    rigs = hit["rig"].nunique()
    for axes, title in (
        (acts, f"(a) hitting; {rigs} rig{'s' * (rigs > 1)}, two pucks"),
        (predicts, "(b) hitting beside predicting, the paper's comparison"),
    ):
        axes.set_xticks(list(places.values()), [str(n) for n in places])
        axes.set_xlabel("hits of the rig seen; of a policy, its own")
        axes.set_title(title, loc="left")
        axes.legend(loc="upper right", handlelength=2.6)
    acts.set_ylim(bottom=0)
    acts.set_ylabel("distance to rest point (cm)")
    note = {"xycoords": "axes fraction", "ha": "right", "fontsize": 7, "color": "#A00000"}
    predicts.annotate(STAND_IN, (0.98, 0.72), **note)
    return Drawing(f"A4-{settings.domain}-policy", figure, pd.concat([summary, beside], ignore_index=True))


def _hits(inputs: Mapping[str, Path]) -> list[pd.DataFrame]:
    """Of every rig: method (empty for the oracle), rig, samples, error_m."""
    parts = []
    for role, folder in inputs.items():
        stage = role.partition("/")[0]
        if stage == "acting":
            acted = read_frame(folder / "acting.parquet")
            parts.append(acted[acted["chooser"].isin(["gradient", "oracle"])])
        elif stage == "policy_acting":
            own = read_frame(folder / "policy.parquet")
            parts.append(own.rename(columns={"hits": "samples"}).assign(method=POLICY))
    return [part[["method", "rig", "samples", "error_m"]] for part in parts]


def _bars(
    axes: Axes, rows: pd.DataFrame, places: Mapping[int, int], shift: float, label: str, method: str
) -> None:
    """Error bars against numbers of hits, evenly spaced."""
    below, above = rows["error_m"] - rows["mean_low_m"], rows["mean_high_m"] - rows["error_m"]
    axes.errorbar(
        rows["samples"].map(places) + shift, 100 * rows["error_m"], yerr=[100 * below, 100 * above],
        color=method_colour(method), linestyle=method_line(method), marker="o", ms=3.5, capsize=2.5, lw=1.6,
        elinewidth=1, label=label,
    )  # fmt: skip
