"""T1, T2: randomised parameters, from the configuration (paper, tables I and II)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.transforms import Bbox

from slapshot.config.randomisation import Distribution, Randomisation
from slapshot.config.results import RandomisationFigureSettings
from slapshot.plotting import Drawing

_SYMBOLS = {"friction_x": r"\mu_x", "friction_y": r"\mu_y"}


Settings = RandomisationFigureSettings


def draw(inputs: Mapping[str, Path], settings: RandomisationFigureSettings) -> Drawing:
    """A table of parameters, distributions and units; constant parameters are omitted."""
    rows = []
    for name in Randomisation.model_fields:
        spec: Distribution = getattr(settings.randomisation, name)
        kind = "normal" if spec.uniform is None else "uniform"
        first, second = spec.numbers
        if first == second if kind == "uniform" else second == 0:
            continue
        rows.append(
            {
                "parameter": name,
                "label": spec.label,
                "distribution": kind,
                "low_or_mean": first,
                "high_or_sd": second,
                "times": spec.times or "",
                "unit": spec.unit,
            }
        )
    table = pd.DataFrame(rows)
    figure, axes = plt.subplots(figsize=(5.6, 0.32 * (len(rows) + 1) + 0.2))
    axes.axis("off")
    cells = [[str(r.label), _formula(r), "" if r.unit == "1" else str(r.unit)] for r in table.itertuples()]
    drawn = axes.table(
        cells, colLabels=["Parameter", "Distribution", "Unit"], cellLoc="left", colWidths=[0.5, 0.38, 0.12],
        bbox=Bbox.unit(), edges="horizontal",
    )  # fmt: skip
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(9)
    for column in range(3):
        drawn[0, column].set_text_props(weight="bold", ha="left")
    return Drawing(f"{settings.figure}-{settings.domain}-randomisation", figure, table)


def _formula(row: Any) -> str:
    letter = "U" if row.distribution == "uniform" else "N"
    times = rf"\,\cdot\,{_SYMBOLS.get(row.times, row.times)}" if row.times else ""
    return rf"$\mathcal{{{letter}}}({_number(row.low_or_mean)},\ {_number(row.high_or_sd)}){times}$"


def _number(value: float) -> str:
    """Without an exponent."""
    return np.format_float_positional(value, precision=6, fractional=False, trim="-")
