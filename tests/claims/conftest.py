"""Fabricated error tables: an error for each method, model, task and number of samples."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from slapshot.claims import c1, c4, c5, c7, comparison
from slapshot.statistics import bootstrap

MODELS = 3
Curve = Callable[[np.ndarray], np.ndarray]  # of samples (n,), in m


def decay(start: float, end: float, scale: float = 4.0) -> Curve:
    """From `start` before any sample to near `end`."""
    return lambda n: end + (start - end) * np.exp(-n / scale)


def times(factor: float, curve: Curve) -> Curve:
    return lambda n: factor * curve(n)


def error_rows(
    curve: Curve, samples: int, keys: pd.DataFrame, seed: int, noise: float = 0.02
) -> pd.DataFrame:
    """The curve for every model and every row of keys, times noise that differs between all of them."""
    rng = np.random.default_rng(seed)
    index = pd.MultiIndex.from_product(
        [range(MODELS), range(len(keys)), range(samples + 1)], names=["model", "task", "samples"]
    )
    table = pd.DataFrame(index=index).reset_index()
    table = table.join(keys.reset_index(drop=True), on="task").drop(columns="task")
    table["error_m"] = curve(table["samples"].to_numpy(float)) * rng.lognormal(0, noise, len(table))
    return table


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    """Fabricated differences are clear, or nothing: 200 draws tell as well as 2000."""
    for module in (c1, c4, c5, c7, comparison):
        monkeypatch.setattr(module, "bootstrap", partial(bootstrap, draws=200))


@pytest.fixture
def write(tmp_path) -> Callable[[dict[str, pd.DataFrame], str], dict[str, Path]]:
    """Role -> folder with each table under a file name."""

    def put(tables: dict[str, pd.DataFrame], name: str = "errors") -> dict[str, Path]:
        folders = {}
        for role, table in tables.items():
            folders[role] = tmp_path / role
            folders[role].mkdir(parents=True, exist_ok=True)
            table.to_parquet(folders[role] / f"{name}.parquet")
        return folders

    return put
