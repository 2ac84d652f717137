"""Panel (b) of the location map: what the nominal scene lacks, against the variable that it follows."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.stats import norm

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.report import residuals
from slapshot.diagnosis.pucks.report.outcome import Launches, Outcome
from slapshot.diagnosis.pucks.report.residuals import CHANCE, Z90
from slapshot.diagnosis.pucks.report.style import ALONG, LEFT
from slapshot.diagnosis.pucks.selection.search import Candidate
from slapshot.effects.effect import Follows

# Spins are not seen, and commands are not part of a slide: their marks are shown against these.
_INSTEAD: dict[str, Follows] = {"spin": "time", "command": "speed"}
# A launch has no time, place or spin of its own: only what was commanded and when.
_INSTEAD_IN_LAUNCH: dict[str, Follows] = {
    "time": "speed",
    "place": "speed",
    "command": "speed",
    "spin": "heading",
}
_AXES: dict[Follows, tuple[str, float]] = {
    "speed": ("speed (m/s)", 1.0),
    "time": ("time since the launch (s)", 1.0),
    "heading": ("direction of motion (degrees from x)", 180 / np.pi),
    "order": ("place in the recording, first hit −50 %, last hit 50 %", 100.0),
}


def shown_variable(outcome: Outcome) -> Follows:
    """What the verdict says; where nothing is found, that of the strongest hypothesis."""
    location = outcome.verdict.location
    variable = location.variable if location is not None else None
    if variable is None:
        best = outcome.screen.best(list(outcome.screen.log_evidence))[0]
        variable = outcome.effect(best).follows
    instead = _INSTEAD_IN_LAUNCH if in_launch(outcome) else _INSTEAD
    return instead.get(variable, variable)


def in_launch(outcome: Outcome) -> bool:
    """Whether the mismatch is in how objects are launched, and launches are known from commands."""
    location = outcome.verdict.location
    phase = location.phase if location is not None else None
    return phase in ("swing", "contact") and outcome.launches is not None


def axis_name(variable: Follows) -> str:
    """The variable in a title."""
    return _AXES[variable][0].split(" (")[0].split(",")[0]


def bin_table(outcome: Outcome, variable: Follows) -> pd.DataFrame:
    """A row a bin and side: the push that the nominal scene and, with effects, the augmented one lacks."""
    fitter = outcome.fitter
    edges = residuals.edges_of(residuals.variable_of(fitter, outcome.nominal, variable))
    tables = []
    for scene, fit in _scenes(outcome).items():
        for side, (value, sd) in residuals.against(fitter, fit, variable, edges).items():
            rows = pd.DataFrame({"scene": scene, "side": side, "bin_low": edges[:-1], "bin_high": edges[1:]})
            tables.append(rows.assign(**bounds(value, sd, 2 * len(value)), unit="m/s^2"))
    return pd.concat(tables, ignore_index=True)


def launch_table(launches: Launches, variable: Follows) -> pd.DataFrame:
    """As `bin_table`, of launch velocities less those of their commands (m/s), averaged over hits."""
    commanded = launches.nominal[:, 2:4]
    speed = np.linalg.norm(commanded, axis=1)
    forward = commanded / np.maximum(speed, 1e-9)[:, None]
    heading = np.arctan2(commanded[:, 1], commanded[:, 0])
    values = {"heading": heading, "order": launches.order}.get(variable, speed)
    edges = residuals.edges_of(values)
    which = np.clip(np.searchsorted(edges, values) - 1, 0, len(edges) - 2)
    tables = []
    for scene in ("nominal", "augmented"):
        expected = getattr(launches, scene)
        if expected is None:
            continue
        off = (launches.measured - expected)[:, 2:4]
        sides = {
            "along": (off * forward).sum(1),
            "left": forward[:, 0] * off[:, 1] - forward[:, 1] * off[:, 0],
        }
        for side, of_hit in sides.items():
            groups = [of_hit[which == k] for k in range(len(edges) - 1)]
            mean = np.array([g.mean() for g in groups])
            error = np.array([g.std(ddof=1) / np.sqrt(len(g)) if len(g) > 1 else np.inf for g in groups])
            rows = pd.DataFrame({"scene": scene, "side": side, "bin_low": edges[:-1], "bin_high": edges[1:]})
            tables.append(rows.assign(**bounds(mean, error, 2 * len(mean)), unit="m/s"))
    return pd.concat(tables, ignore_index=True)


def _scenes(outcome: Outcome) -> dict[str, Candidate]:
    """The nominal scene and, where effects were found, the augmented one."""
    found = {"nominal": outcome.nominal}
    return found | {"augmented": outcome.final} if outcome.final.effects else found


def bounds(value: Array, sd: Array, count: int) -> dict[str, NDArray[Any]]:
    """Columns of a value with its 90 % interval; significant among `count` of them."""
    return {
        "value": value,
        "low": value - Z90 * sd,
        "high": value + Z90 * sd,
        "significant": np.abs(value) > norm.ppf(1 - CHANCE / (2 * count)) * sd,
    }


def draw_bins(axes: Axes, bins: pd.DataFrame, variable: Follows) -> None:
    """Points with intervals, along and to the left; dashed what is left with the effects found."""
    label, factor = _AXES[variable]
    axes.axhline(0, color="black", lw=0.8)
    for (scene, side), rows in bins.groupby(["scene", "side"], sort=False):
        colour = {"along": ALONG, "left": LEFT}[str(side)]
        middle = factor * (rows["bin_low"] + rows["bin_high"]) / 2
        if scene == "augmented":
            axes.plot(middle, rows["value"], "--", color=colour, lw=1, label=f"{side}, with effects found")
            continue
        offset = 0.006 * np.ptp(middle) * (1 if side == "along" else -1)
        below, above = rows["value"] - rows["low"], rows["high"] - rows["value"]
        axes.errorbar(middle + offset, rows["value"], [below, above], color=colour, lw=0.8, elinewidth=1.4)
        for significant, face in ((True, colour), (False, "white")):
            part = (rows["significant"] == significant).to_numpy()
            axes.plot((middle + offset)[part], rows["value"][part], "o", ms=5, mfc=face, mec=colour)
        name = "along the motion" if side == "along" else "to its left"
        axes.plot([], [], "o-", ms=5, color=colour, label=name)
    axes.set_xlabel(label)
    launch = bins["unit"].iloc[0] == "m/s"
    axes.set_ylabel("launch less that of its command (m/s)" if launch else "push that the scene lacks (m/s²)")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.18 * (high - low))
    axes.legend(ncols=2, loc="upper right")
