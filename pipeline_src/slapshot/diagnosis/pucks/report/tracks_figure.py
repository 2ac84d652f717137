"""D3: recorded, nominal and augmented tracks of held-out hits over each other."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.report.outcome import Outcome
from slapshot.diagnosis.pucks.report.predictions import Predicted
from slapshot.diagnosis.pucks.report.style import AUGMENTED, NOMINAL, RECORDED, mark_stand_in
from slapshot.plotting import Drawing

NAME = "D3-tracks"
CAPTION = (
    "Held-out hits whose predictions differ most between the nominal scene (friction refitted) and the scene "
    "with what was found. Launches are told from the frames on grey ground, the rest is predicted. Above: "
    "tracks, turned into the direction of the launch, the deviation to the left magnified; crosses are rest "
    "points. Below: distance between predicted and recorded object. Titles give the rms over what was "
    "predicted, before and after."
)

HITS = 6
_LINES = {"nominal": (NOMINAL, "--"), "augmented": (AUGMENTED, "-")}


def draw(outcome: Outcome) -> Drawing:
    """Two panels a hit: its tracks, and how far they are off."""
    table = track_table(outcome.predicted).assign(noise_m=np.sqrt(2) * outcome.held_out.noise.sd)
    hits = list(dict.fromkeys(table["hit"]))
    figure, grid = plt.subplots(
        2, len(hits), figsize=(max(1.8 * len(hits), 5.0), 4.8), squeeze=False, sharex="row", sharey="row"
    )
    scenes = [scene for scene in _LINES if f"{scene}_along_m" in table]
    for (above, below), hit in zip(grid.T, hits, strict=True):
        rows = table[table["hit"] == hit]
        _draw_track(above, rows, scenes)
        _draw_distance(below, rows, scenes)
        errors = [f"{1e3 * rows[f'{scene}_track_rmse_m'].iloc[0]:.1f}" for scene in scenes]
        above.set_title(f"hit {hit}\n{' → '.join(errors)} mm", loc="left")
        below.set_xlabel("time (s)")
        above.set_xlabel("along (m)")
    grid[0, 0].set_ylabel("to the left (mm)")
    grid[1, 0].set_ylabel("distance from the\nrecorded object (mm)")
    grid[1, 0].set_ylim(bottom=0)
    handles = [Line2D([], [], color=RECORDED, marker=".", ls="", label="recorded")]
    handles += [
        Line2D(
            [], [], color=_LINES[s][0], ls=_LINES[s][1], label="nominal, refitted" if s == "nominal" else s
        )
        for s in scenes
    ]
    handles.append(Line2D([], [], color="black", ls=":", lw=1, label="camera noise (rms)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    mark_stand_in(figure, outcome.verdict)
    return Drawing(NAME, figure, table)


def track_table(predicted: Predicted) -> pd.DataFrame:
    """A row a frame of the hits shown: time, places and distances of each scene; SI units.

    Along and left are measured from the recorded first frame, along the line to the last frame shown.
    """
    scenes = {"nominal": predicted.nominal}
    if predicted.augmented is not None:
        scenes["augmented"] = predicted.augmented
        apart = np.linalg.norm(predicted.augmented - predicted.nominal, axis=-1) * predicted.ahead
    else:
        apart = np.linalg.norm(predicted.nominal - predicted.recorded, axis=-1) * predicted.ahead
    most = np.argsort(-np.sqrt((apart**2).sum(1) / np.maximum(predicted.ahead.sum(1), 1)), kind="stable")
    tables = []
    for i in most[:HITS]:
        valid = predicted.valid[i]
        recorded = predicted.recorded[i][valid]
        turn = _turn(recorded, int(predicted.shown[i].sum()))
        columns: dict[str, Array] = {"t_s": predicted.times[i][valid]}
        columns["launch_told"] = predicted.shown[i][valid]
        for name, places in ({"recorded": recorded} | {n: p[i][valid] for n, p in scenes.items()}).items():
            along, left = (turn @ (places - recorded[0]).T).tolist()
            columns |= {f"{name}_x_m": places[:, 0], f"{name}_y_m": places[:, 1]}
            columns |= {f"{name}_along_m": np.array(along), f"{name}_left_m": np.array(left)}
            if name != "recorded":
                columns[f"{name}_distance_m"] = np.linalg.norm(places - recorded, axis=1)
                columns[f"{name}_track_rmse_m"] = np.full(len(places), predicted.rmse(scenes[name])[i])
        tables.append(pd.DataFrame({"hit": int(predicted.hit[i])} | columns))
    return pd.concat(tables, ignore_index=True)


def _turn(places: Array, count: int) -> Array:
    """(2, 2) rows along the motion over the first `count` frames and to its left."""
    forward = places[max(count - 1, 1)] - places[0]
    forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
    return np.array([forward, [-forward[1], forward[0]]])


def _draw_track(axes: Axes, rows: pd.DataFrame, scenes: list[str]) -> None:
    shown = rows[rows["launch_told"]]
    axes.axvspan(0, shown["recorded_along_m"].max(), color="#EEEEEE", lw=0)
    axes.plot(rows["recorded_along_m"], 1e3 * rows["recorded_left_m"], ".", ms=3, color=RECORDED)
    for scene in ("recorded", *scenes):
        colour, line = _LINES.get(scene, (RECORDED, "-"))
        along, left = rows[f"{scene}_along_m"], 1e3 * rows[f"{scene}_left_m"]
        if scene != "recorded":
            axes.plot(along, left, line, color=colour, lw=1.4)
        axes.plot(along.iloc[-1], left.iloc[-1], "x", ms=7, mew=1.6, color=colour, zorder=4)


def _draw_distance(axes: Axes, rows: pd.DataFrame, scenes: list[str]) -> None:
    axes.axvspan(0, rows[rows["launch_told"]]["t_s"].max(), color="#EEEEEE", lw=0)
    axes.axhline(1e3 * rows["noise_m"].iloc[0], color="black", ls=":", lw=1)
    for scene in scenes:
        colour, line = _LINES[scene]
        axes.plot(rows["t_s"], 1e3 * rows[f"{scene}_distance_m"], line, color=colour, lw=1.4)
