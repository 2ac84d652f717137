"""Principal components of hidden states: what figure 9 shows and claim C7 judges."""

from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.parquet import read_frame
from slapshot.statistics import Projection, principal_components


def read_latents(folder: Path) -> pd.DataFrame:
    """latents.parquet, with friction's magnitude log sqrt(mu_x mu_y) and its direction log(mu_y / mu_x)."""
    table = read_frame(folder / "latents.parquet")
    log_x, log_y = np.log(table["friction_x"]), np.log(table["friction_y"])
    return table.assign(magnitude=(log_x + log_y) / 2, direction=log_y - log_x)


def fit_projection(latents: pd.DataFrame, count: int = 2) -> Projection:
    """Components of one model's hidden states over drawn test conditions, levels of noise and samples.

    Recordings and named conditions have no part in it. The first component is turned to grow with
    friction's magnitude, the second with its direction.
    """
    rows = latents[(latents["source"] == "simulated") & (latents["name"] == "") & (latents["samples"] > 0)]
    vectors = np.stack(rows["hidden"].to_list()).astype(float)
    guides = rows["magnitude"].to_numpy(), rows["direction"].to_numpy()
    return principal_components(vectors, count).oriented(vectors, *guides)


def at_samples(latents: pd.DataFrame, samples: int) -> pd.DataFrame:
    """Rows after `samples` samples, or after the largest number below it that was kept."""
    kept = latents["samples"].unique()
    return latents[latents["samples"] == max(n for n in kept if n <= samples)]
