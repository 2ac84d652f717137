"""S12: acting on the adapted model, which the paper proposes and does not do."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.comparison import samples_needed
from slapshot.claims.statement import Statement
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "hockey, recorded: an adapted model finds commands that hit targets"

INVERSE = "inverse model"
CHOOSERS = ("gradient", INVERSE)
SAMPLES = 8  # hits seen: where claim C5 compares methods
NEAR = 2.0  # of the oracle's distance, a margin of our own

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From what was done on every rig (role: rig)."""
    table = pd.concat([read_frame(f / "acting.parquet") for f in inputs.values()], ignore_index=True)
    table = table.dropna(subset="error_m")
    seen = max(n for n in table["samples"].unique() if n <= SAMPLES)
    oracle = _by_rig(table[table["chooser"] == "oracle"])
    believing = table.loc[table["chooser"] == INVERSE, "method"].iloc[0]  # alone it has an inverse
    statements = []
    for chooser in CHOOSERS:
        own = table[(table["chooser"] == chooser) & (table["method"] == believing)]
        before, after = (_by_rig(own[own["samples"] == n]) for n in (0, seen))
        note = (
            f"{100 * before.mean():.1f} cm before any hit, {100 * after.mean():.1f} cm after {seen}, "
            f"{100 * oracle.mean():.1f} cm by an oracle that repeats a command known to lead there; "
            f"{len(after)} stand-in rigs"
        )
        statements.append(
            Statement(
                text=f"After {seen} hits the {chooser} misses targets by less than {NEAR:g} times the oracle",
                measure="its distance to targets over the oracle's",
                interval=bootstrap(lambda a, b: float(a.mean() / b.mean()), after[None], oracle[None]),
                below=NEAR,
                paper="could be used to find a much better policy",
                note=note,
            )
        )
    return [*statements, _samples(table[table["method"] == believing], oracle)]


def _samples(own: pd.DataFrame, oracle: Array) -> Statement:
    """How many hits it takes."""
    curves = (
        own[own["chooser"] == CHOOSERS[0]].groupby(["rig", "samples"])["error_m"].mean().unstack("samples")
    )
    samples = curves.columns.to_numpy(float)
    return Statement(
        text=f"The gradient comes within {NEAR:g} times the oracle's distance in {SAMPLES} samples or fewer",
        measure="samples that it takes",
        interval=bootstrap(
            lambda a, b: samples_needed(a, NEAR * b, samples), curves.to_numpy()[None], oracle[None]
        ),
        below=SAMPLES + 0.5,
        note=f"{len(curves)} stand-in rigs; {samples[-1]:g} where it never does",
    )


def _by_rig(rows: pd.DataFrame) -> Array:
    """(rigs,) mean distance in m."""
    return rows.groupby("rig")["error_m"].mean().to_numpy()
