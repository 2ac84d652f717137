"""Reads the Parquet dataset, without importing the code that simulates it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.parquet import damage_named, open_table, read_frame, read_table


@dataclass(frozen=True)
class Sequences:
    """Hits of a split grouped by condition: c conditions with n hits each.

    Attributes:
        state, action, outcome: (c, n, size) in the units of the dataset.
        conditions: the c rows of the table of conditions.
    """

    state: NDArray[np.float32]
    action: NDArray[np.float32]
    outcome: NDArray[np.float32]
    conditions: pd.DataFrame


def read_sequences(folder: Path, split: str) -> Sequences:
    """The split's hits as arrays, in the order of conditions."""
    conditions = read_frame(folder / "conditions.parquet")
    conditions = conditions[conditions["split"] == split].reset_index(drop=True)
    table = read_table(folder / f"hits-{split}.parquet", columns=["state", "action", "outcome"])
    arrays = {}
    for name in table.column_names:
        column = table[name].combine_chunks()
        flat = column.flatten().to_numpy().copy()
        arrays[name] = flat.reshape(len(conditions), -1, column.type.list_size)
    return Sequences(**arrays, conditions=conditions)


def iterate_tracks(folder: Path) -> Iterator[pd.DataFrame]:
    """Iterate over the sampled tracks, one row group at a time.

    Raises:
        InputError: the file is missing or damaged.
    """
    path = folder / "tracks.parquet"
    with damage_named(path):
        file = open_table(path)
    with file:
        for group in range(file.num_row_groups):
            with damage_named(path):
                table = file.read_row_group(group)
            yield table.to_pandas()
