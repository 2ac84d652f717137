"""Principal components of hidden states, for figure 9 and claim C7."""

from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.parquet import read_frame
from slapshot.statistics import Projection, principal_components


def read_latents(folder: Path) -> pd.DataFrame:
    """Read latents.parquet; add friction's magnitude log sqrt(mu_x mu_y) and direction log(mu_y / mu_x)."""
    table = read_frame(folder / "latents.parquet")
    log_x, log_y = np.log(table["friction_x"]), np.log(table["friction_y"])
    return table.assign(magnitude=(log_x + log_y) / 2, direction=log_y - log_x)


def fit_projection(latents: pd.DataFrame, count: int = 2) -> Projection:
    """Fit components to one model's hidden states over drawn test conditions, noise levels and samples.

    Recordings and named conditions are not used for the fit. The sign of the first component is chosen so
    that it increases with friction's magnitude, that of the second so that it increases with its direction.
    """
    rows = latents[(latents["source"] == "simulated") & (latents["name"] == "") & (latents["samples"] > 0)]
    vectors = np.stack(rows["hidden"].to_list()).astype(float)
    guides = rows["magnitude"].to_numpy(), rows["direction"].to_numpy()
    return principal_components(vectors, count).oriented(vectors, *guides)


def at_samples(latents: pd.DataFrame, samples: int) -> pd.DataFrame:
    """Rows after `samples` samples, or after the largest stored number below it."""
    kept = latents["samples"].unique()
    return latents[latents["samples"] == max(n for n in kept if n <= samples)]
