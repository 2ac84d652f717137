"""C1: the belief narrows, and with drift never to nothing (paper, section "Linear regression")."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.statement import Statement
from slapshot.parquet import read_frame
from slapshot.statistics import Interval, bootstrap

TITLE = "linear regression: the belief narrows with samples and stays above zero for Q > 0"

SEEN = (2, 10)  # samples of the paper's figure 3
LEVEL = 0.9  # a variance that keeps 90 % of itself while samples double has come to rest; 1/n keeps half

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the walkthrough's many tasks (role: regression)."""
    table = read_frame(inputs["regression"] / "contraction.parquet")
    drift = table["drift"].max()
    trained, still = table[table["drift"] == drift], table[table["drift"] == 0]
    statements = [_phi(trained, n) for n in SEEN] + [_y(trained, n) for n in SEEN]
    last, half = trained["samples"].max(), trained["samples"].max() // 2
    paper = "due to non-zero Q, the uncertainty never goes down to zero"
    if drift > 0:
        statements.append(
            Statement(
                text=f"With Q = {drift:g} I the belief over phi stops narrowing above zero",
                measure=f"smallest variance after {last} samples over that after {half}",
                interval=_ratio(trained, "smallest_eigenvalue", last, half),
                above=LEVEL,
                paper=paper,
                note=f"it is {_mean(trained, last):.2g} then, the prior's is {_mean(trained, 0):.2g}",
            )
        )
    statements.append(
        Statement(
            text="With Q = 0 it goes on narrowing, towards zero",
            measure=f"smallest variance after {last} samples over that after {half}",
            interval=_ratio(still, "smallest_eigenvalue", last, half),
            below=LEVEL,
            paper=paper,
            note="the same trained weights without drift; one over the number of samples would give 0.5",
        )
    )
    return statements


def _phi(table: pd.DataFrame, samples: int) -> Statement:
    def ratio(after: Array, before: Array) -> float:
        # The determinant is the square of an ellipse's area (of a volume in more dimensions).
        return float(np.exp((after - before).mean() / 2))

    arrays = _arrays(table, "log_determinant", samples, 0)
    return Statement(
        text=f"The belief over phi narrows by {samples} samples",
        measure=f"area of its ellipse after {samples} samples over that of the prior's, geometric mean",
        interval=bootstrap(ratio, *arrays),
        below=1,
        paper="the variance of the latent variable noticeably goes down",
    )


def _y(table: pd.DataFrame, samples: int) -> Statement:
    exact = table.groupby("samples")["exact_sd_y"].mean()
    return Statement(
        text=f"The belief over y narrows by {samples} samples",
        measure=f"standard deviation of y after {samples} samples over that before any",
        interval=_ratio(table, "sd_y", samples, 0),
        below=1,
        paper="the variance of the prediction goes down",
        note=f"the exact posterior's ratio is {exact[samples] / exact[0]:.2f}",
    )


def _ratio(table: pd.DataFrame, column: str, after: int, before: int) -> Interval:
    return bootstrap(lambda a, b: float(a.mean() / b.mean()), *_arrays(table, column, after, before))


def _arrays(table: pd.DataFrame, column: str, *samples: int) -> list[Array]:
    """(models, tasks) of a column after each number of samples."""
    wide = table.pivot(index=["samples", "model"], columns="task", values=column)
    return [wide.loc[n].to_numpy() for n in samples]


def _mean(table: pd.DataFrame, samples: int) -> float:
    return float(table.loc[table["samples"] == samples, "smallest_eigenvalue"].mean())
