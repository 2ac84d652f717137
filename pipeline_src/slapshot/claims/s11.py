"""S11: ranges of randomisation from beliefs about recordings, which the paper proposes and does not do."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.statement import Statement
from slapshot.statistics import bootstrap

TITLE = "hockey, recorded: beliefs narrow the ranges of randomisation"

NOMINAL = 0.9  # of 5 to 95 % ranges
LEAST = 0.8  # coverage from which on ranges may be used, a margin of our own
_NAMES = {
    "friction_x": "friction along x",
    "friction_y": "the ratio of frictions",
    "mass": "mass",
    "friction_torsional": "torsional friction",
}

Array = NDArray[np.floating]


def judge(inputs: Mapping[str, Path]) -> list[Statement]:
    """From ranges and truths of all rigs (role: coverage)."""
    table = pd.read_parquet(inputs["coverage"] / "coverage.parquet")
    statements = []
    for parameter, name in _NAMES.items():
        own = table[(table["parameter"] == parameter) & table["drawable"]]
        if own.empty:
            continue
        by_rig = own.assign(width=(own["high"] - own["low"]) / (own["prior_high"] - own["prior_low"]))
        rigs = by_rig.groupby("rig")[["inside", "width"]].mean().astype(float)
        off = (own["median"] / own["truth"]).median()
        statements.append(
            Statement(
                text=f"Refined ranges of {name} hold the truth",
                measure=f"share of rigs and pucks whose 5 to 95 % range does; nominal {NOMINAL:g}",
                interval=bootstrap(lambda a: float(a.mean()), rigs["inside"].to_numpy()[None]),
                above=LEAST,
                paper="a range of randomization parameters that encapsulate the real conditions",
                note=(
                    f"ranges are {100 * rigs['width'].median():.0f} % as wide as those of training in the "
                    f"median, their middle is {off:.2f} times the truth; {len(rigs)} stand-in rigs, whose "
                    "blade bends and whose board is uneven: what training lacks is taken for another "
                    "friction or mass"
                ),
            )
        )
    return statements
