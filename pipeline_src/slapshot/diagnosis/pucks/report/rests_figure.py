"""D1 of rest points alone: where commands should have sent objects, and where they came to lie."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.diagnosis.pucks.report.outcome import RestOutcome
from slapshot.diagnosis.pucks.report.style import AUGMENTED, NOMINAL, RECORDED, mark_stand_in
from slapshot.plotting import Drawing

NAME = "D1-rests"
CAPTION = (
    "Rest points as recorded, each with a line from where its command should have sent the object: in the "
    "nominal scene with friction refitted, and with what was found. Hits that took part in fitting."
)


def draw(outcome: RestOutcome) -> Drawing:
    """Panel (a) the nominal scene, refitted; (b) with what was found, where anything was."""
    table = rest_table(outcome)
    scenes = list(dict.fromkeys(table["scene"]))
    figure, row = plt.subplots(
        1, len(scenes), figsize=(1.0 + 3.6 * len(scenes), 4.6), squeeze=False, sharex=True, sharey=True
    )
    titles = {"refitted": "nominal scene, friction refitted", "augmented": "with what was found"}
    for axes, letter, scene in zip(row[0], "ab", scenes, strict=False):
        _panel(axes, table[table["scene"] == scene], NOMINAL if scene == "refitted" else AUGMENTED)
        axes.set_title(f"({letter}) {titles[scene]}", loc="left")
    row[0][0].set_ylabel("y (m)")
    handles, labels = row[0][-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    mark_stand_in(figure, outcome.verdict)
    return Drawing(NAME, figure, table)


def rest_table(outcome: RestOutcome) -> pd.DataFrame:
    """A row a hit and scene: recorded and predicted rest point in m."""
    level = outcome.level
    fits = {"refitted": level.nominal.fit}
    if level.final.effects:
        fits["augmented"] = level.final.fit
    fitter = level.search.fitter
    parts = []
    for scene, fit in fits.items():
        columns = {"x_m": fitter.measured[:, 0], "y_m": fitter.measured[:, 1]}
        predicted = fitter.predict(fit.point)
        columns |= {"predicted_x_m": predicted[:, 0], "predicted_y_m": predicted[:, 1]}
        parts.append(pd.DataFrame(columns).assign(scene=scene))
    return pd.concat(parts, ignore_index=True)


def _panel(axes: Axes, rows: pd.DataFrame, colour: str) -> None:
    ends = rows[["predicted_x_m", "x_m"]].to_numpy().T, rows[["predicted_y_m", "y_m"]].to_numpy().T
    axes.plot(*ends, color=colour, lw=0.8)
    axes.plot(rows["x_m"], rows["y_m"], ".", color=RECORDED, ms=4, label="recorded")
    axes.plot([], [], color=colour, lw=0.8, label="from where its command should have sent it")
    apart = np.hypot(rows["x_m"] - rows["predicted_x_m"], rows["y_m"] - rows["predicted_y_m"])
    rms = 1e3 * float(np.sqrt((apart**2).mean()))
    axes.annotate(f"rms {rms:.0f} mm", (0.98, 0.02), xycoords="axes fraction", ha="right", fontsize=8)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x (m)")
