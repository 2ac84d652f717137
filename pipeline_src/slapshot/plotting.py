"""Style of all figures, colours of methods, and how figures are written."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

# Palette of Okabe and Ito, suitable for colour-blind readers. One colour per method in all figures.
METHOD_COLOURS = {
    "kalman": "#0072B2",
    "lstm": "#D55E00",
    "maml_1": "#7CCFB4",
    "maml_4": "#009E73",
    "maml_8": "#00543D",
    "policy": "#CC79A7",
}
METHOD_NAMES = {
    "kalman": "Kalman",
    "lstm": "LSTM",
    "maml_1": "MAML, 1 an update",
    "maml_4": "MAML, 4 an update",
    "maml_8": "MAML, 8 an update",
    "policy": "policy adaptation",
}
# Line styles distinguish methods without colour, too.
_LINES = {"lstm": "--", "maml_1": ":", "maml_4": "-.", "maml_8": (0, (6, 1, 1, 1, 1, 1))}
OTHER_COLOURS = ("#E69F00", "#56B4E9", "#000000", "#F0E442")
# Named test conditions of a domain, in the same colour in all figures; no recorded puck is purple.
FRICTIONS = ("low friction", "medium friction", "high friction")
CONDITION_COLOURS = {
    "low friction": "#56B4E9",
    "medium friction": "#009E73",
    "high friction": "#5B4A9C",
    "low along x": "#E69F00",
    "low along y": "#CC79A7",
}
STAND_IN = "stand-in rig (simulated), not a real robot"

_STYLE: dict[Any, Any] = {
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "svg.hashsalt": "slapshot",
    "pdf.fonttype": 42,
}


@dataclass(frozen=True)
class Drawing:
    """A finished figure.

    Attributes:
        name: file name without suffix; begins with the figure's id.
        figure: the matplotlib figure.
        table: every number shown, in SI units.
    """

    name: str
    figure: Figure
    table: pd.DataFrame


def use_style() -> None:
    """Set the style of all figures."""
    mpl.use("agg")
    plt.style.use("default")
    mpl.rcParams.update(_STYLE)


def save(drawing: Drawing, folder: Path) -> None:
    """Write PNG, PDF and CSV; equal drawings give equal bytes."""
    # matplotlib stamps PDFs with this time instead of now.
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    drawing.figure.savefig(folder / f"{drawing.name}.png", metadata={"Software": None})
    drawing.figure.savefig(folder / f"{drawing.name}.pdf")
    drawing.table.to_csv(folder / f"{drawing.name}.csv", index=False, float_format="%.6g")
    plt.close(drawing.figure)


def method_colour(method: str) -> str:
    """The method's colour."""
    return METHOD_COLOURS.get(method, OTHER_COLOURS[hash_of(method) % len(OTHER_COLOURS)])


def method_line(method: str) -> Any:
    """The method's line style."""
    return _LINES.get(method, "-")


def hash_of(text: str) -> int:
    """A small number that, unlike hash(), is the same in every process."""
    return sum(text.encode())


def method_name(method: str) -> str:
    """Name of a method in legends."""
    return METHOD_NAMES.get(method, method.replace("_", " "))
