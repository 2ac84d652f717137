"""Colours and marks that the figures of a diagnosis share with its Rerun recording."""

from matplotlib.figure import Figure

from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.plotting import METHOD_COLOURS, STAND_IN

RECORDED = "#D55E00"
BELIEVED = "#A6761D"
NOMINAL = "#7A7A7A"
AUGMENTED = METHOD_COLOURS["kalman"]
PUSH = "#7A1FA2"
NOTHING = "#BBBBBB"  # what may be chance
ALONG, LEFT = "#009E73", "#CC79A7"
_WARNING = "#A00000"


def mark_stand_in(figure: Figure, verdict: Verdict) -> None:
    """Say at the top where the recording is no robot's."""
    if verdict.stand_in:
        figure.suptitle(f"recorded: {STAND_IN}", fontsize=7, color=_WARNING, x=0.995, ha="right")
