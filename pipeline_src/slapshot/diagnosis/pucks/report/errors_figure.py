"""D4: errors on held-out hits before and after, against what noise alone leaves."""

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from slapshot.diagnosis.pucks.report.outcome import Outcome, RestOutcome
from slapshot.diagnosis.pucks.report.sentences import scenes
from slapshot.diagnosis.pucks.report.style import AUGMENTED, BELIEVED, NOMINAL, mark_stand_in
from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.json_types import Row
from slapshot.plotting import Drawing

NAME = "D4-errors"
CAPTION = (
    "Errors on hits that took no part in fitting or choosing, each predicted from its first frames, rest "
    "points also from the command alone where it is known; bars are 90 % bootstrap intervals over hits. "
    "Noise floor: what camera noise, a launch told from few frames and the scatter of launches leave of the "
    "best scene. Log-likelihoods are over the nominal scene, refitted."
)

_PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}  # behind a number
# Measure -> title, unit, factor.
_MEASURES = {
    "track_rmse_m": ("track error", "rms, mm", 1e3),
    "rest_rmse_m": ("rest-point error", "rms, mm", 1e3),
    "command_rest_rmse_m": ("rest point from command", "rms, mm", 1e3),
    "loglik_per_hit": ("log-likelihood a hit", "nats", 1.0),
}
_TICKS = [k * 10**p for p in range(-1, 4) for k in (1, 2, 3, 5, 7)]  # mm
_ROWS = {
    "nominal": ("nominal,\nas believed", BELIEVED),
    "refitted": ("nominal,\nrefitted", NOMINAL),
    "augmented": ("augmented", AUGMENTED),
    "noise_floor": ("noise floor", "black"),
}


def draw(outcome: Outcome | RestOutcome) -> Drawing:
    """A panel a measure: tracks, rest points, those from commands where they are known, log-likelihood."""
    table = error_table(outcome.verdict)
    measured = list(dict.fromkeys(table["measure"]))
    drawn = scenes(outcome.verdict)
    figure, axes = plt.subplots(1, len(measured), figsize=(1.2 + 3 * len(measured), 2.6), sharey=True)
    for part, letter, measure in zip(axes, "abcd", measured, strict=False):
        title, unit, factor = _MEASURES[measure]
        _draw_measure(
            part, table[table["measure"] == measure], drawn, factor, likelihood=measure == "loglik_per_hit"
        )
        part.set_title(f"({letter}) {title}", loc="left")
        part.set_xlabel(unit)
    mark_stand_in(figure, outcome.verdict)
    return Drawing(NAME, figure, table)


def error_table(verdict: Verdict) -> pd.DataFrame:
    """A row a scene and measure: value with its 90 % interval, in SI units."""
    assert verdict.fit is not None
    rows: list[Row] = []
    for scene in scenes(verdict):
        for measure in _MEASURES:
            interval = getattr(verdict.fit[scene], measure)
            if interval is not None:
                rows.append({"measure": measure, "scene": scene, **vars(interval)})
    return pd.DataFrame(rows)


def _draw_measure(axes: Axes, rows: pd.DataFrame, drawn: list[str], factor: float, likelihood: bool) -> None:
    """Points with intervals; of a likelihood far below the others, only its value is said."""
    far = likelihood
    known = {row["scene"]: row for _, row in rows.iterrows()}
    if "noise_floor" in known:
        axes.axvline(factor * known["noise_floor"]["value"], color="black", lw=1, ls=":")
    # Far below the others it would leave them no room.
    others = [known[scene]["low"] for scene in known if scene != "nominal"]
    far = far and known["nominal"]["value"] < min(others)
    for y, scene in zip(range(len(drawn))[::-1], drawn, strict=True):
        if scene not in known:
            axes.annotate(
                "cannot be told", (0.03, y), xycoords=("axes fraction", "data"), fontsize=8, va="center"
            )
            continue
        value, low, high = (factor * known[scene][name] for name in ("value", "low", "high"))
        colour = _ROWS[scene][1]
        text = f"{value:.2f}" if likelihood else f"{value:.1f}"
        if far and scene == "nominal":
            text = f"← {value:.0f} ({low:.0f} to {high:.0f})".replace("-", "−")
            axes.annotate(
                text, (0.03, y), xycoords=("axes fraction", "data"), color=colour, fontsize=8, va="center"
            )
            continue
        axes.errorbar(value, y, xerr=[[value - low], [high - value]], fmt="o", ms=6, color=colour, capsize=3)
        axes.annotate(
            text, (value, y), (0, 8), textcoords="offset points", fontsize=8, ha="center", bbox=_PAPER
        )
    axes.set_yticks(range(len(drawn))[::-1], [_ROWS[scene][0] for scene in drawn])
    axes.set_ylim(-0.6, len(drawn) - 0.4)
    axes.grid(axis="y", visible=False)
    if not likelihood:
        axes.set_xscale("log")
        low, high = axes.get_xlim()
        shown = [t for t in _TICKS if low <= t <= high]
        axes.set_xticks(shown, [f"{t:g}" for t in shown])
        axes.xaxis.set_minor_locator(NullLocator())
