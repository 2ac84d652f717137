"""D1: where the mismatch is: over the board, and against the variable that it follows."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.patches import Rectangle

from slapshot.diagnosis.pucks.report import residuals
from slapshot.diagnosis.pucks.report.by_variable import (
    axis_name,
    bin_table,
    bounds,
    draw_bins,
    in_launch,
    launch_table,
    shown_variable,
)
from slapshot.diagnosis.pucks.report.outcome import Outcome
from slapshot.diagnosis.pucks.report.style import NOTHING, PUSH, mark_stand_in
from slapshot.plotting import Drawing

NAME = "D1-location"
CAPTION = (
    "Pushes that the nominal scene lacks once friction is refitted. (a) Over the board where hits went (grey "
    "lines); purple arrows are unlikely to be chance (90 %, all arrows taken together, and only where the "
    "verdict finds a mismatch), grey ones may be. (b) By the "
    "variable that the mismatch follows, along the motion and to its left (of launches: how they differ from "
    "those of their commands); bars are 90 % intervals, hollow "
    "is what may be chance, dashed what is left with the effects found in the scene."
)

LONGEST_ARROW = 0.24  # m


def draw(outcome: Outcome) -> Drawing:
    """Panels (a) push over the board, (b) push by the variable that the mismatch follows."""
    arrows = outcome.arrows
    tracks = _tracks(outcome)
    variable = shown_variable(outcome)
    figure, (a, b) = plt.subplots(1, 2, figsize=(10.2, 4.7))
    _draw_board(a, tracks, arrows)
    _draw_arrows(a, arrows)
    a.set_title("(a) push that the scene lacks, over the board", loc="left")
    launches = outcome.launches if in_launch(outcome) else None
    if variable == "place" and launches is None:
        own = outcome.judged(_along_table(outcome))
        _draw_board(b, tracks, arrows)
        _draw_along(b, own)
        b.set_title("(b) its part along the motion, by place", loc="left")
    else:
        own = outcome.judged(
            bin_table(outcome, variable) if launches is None else launch_table(launches, variable)
        )
        draw_bins(b, own, variable)
        told = outcome.verdict.location.variable if outcome.verdict.location is not None else None
        unseen = f"; {told} is not seen" if told not in (None, variable) else ""
        what = "push" if launches is None else "launch"
        b.set_title(f"(b) {what} by {axis_name(variable)}{unseen}", loc="left")
    mark_stand_in(figure, outcome.verdict)
    table = pd.concat(
        [arrows.assign(panel="a"), own.assign(panel="b", variable=variable), tracks.assign(panel="tracks")],
        ignore_index=True,
    )
    first = ["panel", "variable"]
    return Drawing(NAME, figure, table[[*first, *(c for c in table if c not in first)]])


def _along_table(outcome: Outcome) -> pd.DataFrame:
    places, hits = residuals.cells(outcome.fitter)
    value, sd = residuals.along_at(outcome.fitter, outcome.nominal, places)
    table = pd.DataFrame({"x_m": places[:, 0], "y_m": places[:, 1], "hits": hits, "side": "along"})
    return table.assign(**bounds(value, sd, len(value)))


def _tracks(outcome: Outcome) -> pd.DataFrame:
    """Frames of all hits that were used."""
    tracks, valid = outcome.fitter.model.tracks, outcome.fitter.valid
    places = tracks.places[valid]
    return pd.DataFrame(
        {"hit": np.repeat(tracks.hit, valid.sum(1)), "x_m": places[:, 0], "y_m": places[:, 1]}
    )


def _draw_board(axes: Axes, tracks: pd.DataFrame, arrows: pd.DataFrame) -> None:
    for _, rows in tracks.groupby("hit"):
        axes.plot(rows["x_m"], rows["y_m"], color="#C9C9C9", lw=0.6, zorder=1)
    scale = arrow_scale(arrows)
    tips = pd.DataFrame(
        {"x_m": arrows["x_m"] + scale * arrows["ax_m_s2"], "y_m": arrows["y_m"] + scale * arrows["ay_m_s2"]}
    )
    places = pd.concat([tracks[["x_m", "y_m"]], tips])
    low, high = places.min(), places.max()
    middle, span = (low + high) / 2, 1.2 * (high - low).max()
    left = low["x_m"] - 0.15 * span  # what is empty is on the right, where the legend is
    axes.set_xlim(left, left + span)
    axes.set_ylim(middle["y_m"] - span / 2, middle["y_m"] + span / 2)
    axes.set_aspect("equal")
    axes.grid(False)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def arrow_scale(arrows: pd.DataFrame) -> float:
    """Length in m of an arrow for 1 m/s^2."""
    longest = np.hypot(arrows["ax_m_s2"], arrows["ay_m_s2"]).max()
    return LONGEST_ARROW / max(float(longest), 0.05)


def _draw_arrows(axes: Axes, arrows: pd.DataFrame) -> None:
    scale = arrow_scale(arrows)
    for significant, colour in ((False, NOTHING), (True, PUSH)):
        rows = arrows[arrows["significant"] == significant]
        quiver = axes.quiver(
            rows["x_m"], rows["y_m"], rows["ax_m_s2"], rows["ay_m_s2"], color=colour, angles="xy",
            scale_units="xy", scale=1 / scale, width=0.006 if significant else 0.004, zorder=3,
        )  # fmt: skip
    length = _round_length(0.6 * LONGEST_ARROW / scale)
    axes.quiverkey(quiver, 0.86, 0.05, length, f"{length:g} m/s²", labelpos="N", color="#444444")
    axes.plot([], [], color=PUSH, label="unlikely to be chance")
    axes.plot([], [], color=NOTHING, label="may be chance")
    axes.legend(loc="upper right")


def _round_length(length: float) -> float:
    """1, 2 or 5 times a power of ten, at most `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(k * power for k in (1, 2, 5) if k * power <= length))


def _draw_along(axes: Axes, cells: pd.DataFrame) -> None:
    most = max(float(cells["value"].abs().max()), 0.05)
    corner = cells[["x_m", "y_m"]].to_numpy() - residuals.CELL / 2
    squares = [Rectangle((x, y), residuals.CELL, residuals.CELL) for x, y in corner]
    for significant, alpha in ((False, 0.35), (True, 1.0)):
        rows = np.flatnonzero(cells["significant"] == significant)
        drawn = PatchCollection([squares[r] for r in rows], cmap="RdBu", alpha=alpha, zorder=2)
        drawn.set_array(cells["value"].to_numpy()[rows])
        drawn.set_clim(-most, most)
        drawn.set_edgecolor("#333333" if significant else "none")
        axes.add_collection(drawn)
    bar = axes.figure.colorbar(ScalarMappable(Normalize(-most, most), "RdBu"), ax=axes, shrink=0.85)
    bar.set_label("push along the motion (m/s²); red brakes")
    axes.scatter(
        [], [], s=70, marker="s", color="#999999", edgecolors="#333333", label="unlikely to be chance"
    )
    axes.scatter([], [], s=70, marker="s", color="#DDDDDD", edgecolors="none", label="may be chance")
    axes.legend(loc="upper right")
