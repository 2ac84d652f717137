"""D1 of a recording from which nothing can be told: its hits, with those that are left out or to blame."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from slapshot.diagnosis.pucks.report.style import NOTHING, mark_stand_in
from slapshot.diagnosis.pucks.result import Diagnosis
from slapshot.plotting import Drawing
from slapshot.recordings.track_features import hit_tracks

NAME = "D1-hits"
CAPTION = (
    "All hits as the camera saw them: (a) over the board, (b) their speed since they first moved. Red: hits "
    "to blame, with their numbers; orange: hits that were left out; grey: the others."
)

_STATES = {"used": (NOTHING, 0.7), "left out": ("#E69F00", 1.1), "to blame": ("#A00000", 1.6)}


def draw(diagnosis: Diagnosis) -> Drawing:
    """Panels (a) tracks over the board, (b) speed against time."""
    table = hit_table(diagnosis)
    figure, (a, b) = plt.subplots(1, 2, figsize=(10.2, 4.7), width_ratios=[1, 1.1])
    for state in _STATES:
        _draw_hits(a, b, table[table["state"] == state], state)
    a.set_title("(a) tracks", loc="left")
    a.set_aspect("equal")
    a.set_xlabel("x (m)")
    a.set_ylabel("y (m)")
    b.set_title("(b) speed", loc="left")
    b.set_xlabel("time since it first moved (s)")
    b.set_ylabel("speed (m/s)")
    b.set_ylim(0, 1.1 * float(table["speed_m_s"].quantile(0.999)))
    b.legend(loc="upper right")
    mark_stand_in(figure, diagnosis.verdict)
    return Drawing(NAME, figure, table)


def hit_table(diagnosis: Diagnosis) -> pd.DataFrame:
    """A row a frame: hit, what became of it, time since it first moved (s), place (m) and speed (m/s)."""
    assert diagnosis.recording is not None
    blamed = set(diagnosis.verdict.hits_to_blame)
    parts = []
    for track in hit_tracks(diagnosis.recording):
        state = "left out" if track.hit in diagnosis.left_out else "used"
        begin = track.t[track.slide.begin] if track.slide is not None else track.t[0]
        columns = {"x_m": track.xy[:, 0], "y_m": track.xy[:, 1], "speed_m_s": track.speed}
        parts.append(
            pd.DataFrame({"t_s": track.t - begin, **columns}).assign(
                hit=track.hit, state="to blame" if track.hit in blamed else state
            )
        )
    table = pd.concat(parts, ignore_index=True)
    return table[["hit", "state", "t_s", "x_m", "y_m", "speed_m_s"]]


def _draw_hits(a: Axes, b: Axes, rows: pd.DataFrame, state: str) -> None:
    colour, width = _STATES[state]
    hits = list(dict.fromkeys(rows["hit"]))
    for hit in hits:
        own = rows[rows["hit"] == hit]
        a.plot(own["x_m"], own["y_m"], color=colour, lw=width)
        moving = own[own["t_s"] >= -0.05]
        b.plot(moving["t_s"], moving["speed_m_s"], color=colour, lw=width)
        if state == "to blame":
            fastest = moving["speed_m_s"].to_numpy().argmax()
            b.annotate(
                str(hit), (moving["t_s"].iloc[fastest], moving["speed_m_s"].iloc[fastest]), color=colour
            )
            end = own[["x_m", "y_m"]].to_numpy()[-1]
            a.annotate(str(hit), (float(end[0]), float(end[1])), color=colour)
    if hits:
        said = "others" if state == "used" else state
        b.plot([], [], color=colour, lw=width, label=f"{said} ({len(hits)})")


def can_be_drawn(diagnosis: Diagnosis) -> bool:
    """Whether there is anything to see: frames of any hit."""
    recording = diagnosis.recording
    return (
        recording is not None and recording.tracks is not None and bool(np.any(recording.tracks["hit"] >= 0))
    )
