"""S13: informed exploration, which the paper proposes and does not do."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slapshot.claims.comparison import samples_to_reach
from slapshot.claims.statement import Statement, error_array
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "hockey, recorded: hits that the belief chooses teach more than sampled latents"

AT = (1, 2, 4)  # informed samples whose error the other arm must reach
HALF = 0.5

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the errors of both arms (role: exploration)."""
    table = read_frame(inputs["exploration"] / "exploration.parquet")
    arms = {arm: error_array(rows, ["recording", "rig"]) for arm, rows in table.groupby("arm", sort=False)}
    informed, sampled = arms["informed"], arms["sampled"]
    most = sampled.shape[2] - 1
    return [
        Statement(
            text=f"Informed exploration needs at most half the samples, for the error that it has after {at}",
            measure="its samples over those that latent sampling needs for that error",
            interval=bootstrap(lambda a, b, n=at: _share(a, b, n), informed, sampled),
            below=HALF,
            paper="likely that a more informed search strategy would [...] adapt with fewer samples",
            note=(
                f"{100 * informed[:, :, at].mean():.1f} cm after {at}, latent sampling "
                f"{100 * sampled[:, :, at].mean():.1f} cm; {informed.shape[1]} rigs; candidates are recorded "
                "hits"
            ),
        )
        for at in AT
        if at < most
    ]


def _share(informed: Array, sampled: Array, at: int) -> float:
    """Of the samples; where latent sampling never gets there, as if it did with the last one."""
    curve, other = informed.mean((0, 1)), sampled.mean((0, 1))
    return at / min(samples_to_reach(other, curve[at]), len(other) - 1)
