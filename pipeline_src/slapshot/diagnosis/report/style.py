"""Colours and marks that the figures of a diagnosis share with its Rerun recording."""

from matplotlib.figure import Figure

from slapshot.diagnosis.verdict import Verdict
from slapshot.plotting import METHOD_COLOURS, OTHER_COLOURS, STAND_IN

RECORDED = "#D55E00"
NOMINAL = "#7A7A7A"
REFITTED = "#A6761D"
AUGMENTED = METHOD_COLOURS["kalman"]
FREE_FORM = OTHER_COLOURS[0]
NOISE = "#C9DFC3"  # band of what noise alone leaves
MODEL_COLOURS = {"nominal": NOMINAL, "refitted": REFITTED, "augmented": AUGMENTED, "noise_floor": "black"}
Z90 = 1.645
_WARNING = "#A00000"


def mark_stand_in(figure: Figure, verdict: Verdict) -> None:
    """Say at the top where the recording is no robot's."""
    if verdict.stand_in:
        figure.suptitle(f"recorded: {STAND_IN}", fontsize=7, color=_WARNING, x=0.995, ha="right")
