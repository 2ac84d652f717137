"""J3: prediction errors of held-out windows by model, against what noise alone leaves."""

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes

from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.presentation import MODEL_COLOURS, error_unit, mark_stand_in, shown_models
from slapshot.diagnosis.verdict import Verdict
from slapshot.json_types import Row
from slapshot.plotting import Drawing

NAME = "J3-errors"
CAPTION = (
    "Root mean square errors of held-out windows, by kind of channel, with 90 % bootstrap intervals "
    "over windows. Dotted: what noise of the readings alone leaves of the model that explains most."
)
_NAMES = {
    "nominal": "nominal,\nas given",
    "refitted": "nominal,\nrefitted",
    "augmented": "with what\nwas found",
    "noise_floor": "noise floor",
}
_MAX_SHOWN = 4  # quantities in a row


def draw(outcome: Outcome) -> Drawing:
    """A panel a quantity."""
    table = error_table(outcome.verdict)
    kinds = list(dict.fromkeys(table["kind"]))
    columns = min(len(kinds), _MAX_SHOWN)
    rows = -(-len(kinds) // columns)
    models = shown_models(outcome.verdict)
    size = (max(1.4 + 2.6 * columns, 5.5), rows * (0.9 + 0.42 * len(models)))
    figure, grid = plt.subplots(rows, columns, figsize=size, sharey=True, squeeze=False)
    for axes, kind in zip(grid.flat, kinds, strict=False):
        _draw(axes, outcome.verdict, table[table["kind"] == kind])
        axes.set_title(kind, loc="left")
    for axes in grid.flat[len(kinds) :]:
        axes.set_axis_off()
    mark_stand_in(figure, outcome.verdict)
    return Drawing(NAME, figure, table)


def error_table(verdict: Verdict) -> pd.DataFrame:
    """A row a model and quantity: value with its 90 % interval, in SI units."""
    assert verdict.fit is not None
    rows: list[Row] = []
    for model in shown_models(verdict):
        for kind, interval in getattr(verdict.fit, model).rms.items():
            rows.append({"kind": kind, "model": model, **interval.model_dump()})
    return pd.DataFrame(rows)


def _draw(axes: Axes, verdict: Verdict, table: pd.DataFrame) -> None:
    unit, factor = error_unit(verdict, str(table["kind"].iloc[0]))
    models = shown_models(verdict)
    known = {row["model"]: row for row in table.to_dict("records")}
    most = factor * float(table["high"].max())
    for y, model in zip(range(len(models))[::-1], models, strict=True):
        value, low, high = (factor * float(known[model][name]) for name in ("value", "low", "high"))
        if model == "noise_floor":
            axes.axvline(value, color="black", lw=1, ls=":")
        axes.barh(y, value, height=0.6, color=MODEL_COLOURS[model], alpha=0.85, lw=0)
        if high > low:
            axes.errorbar(value, y, xerr=[[value - low], [high - value]], color="black", lw=1, capsize=3)
        axes.annotate(
            f"{value:.3g}", (max(high, value), y), (4, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.set_xlim(0, 1.18 * most)
    axes.set_yticks(range(len(models))[::-1], [_NAMES[model] for model in models])
    axes.set_ylim(-0.6, len(models) - 0.4)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(f"rms error ({unit})" if unit else "rms error")
