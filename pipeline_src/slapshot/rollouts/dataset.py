"""Writes the Parquet dataset: one table of hits per split, one of conditions, one of sampled tracks.

Every column has its unit in the field's metadata. `state`, `action` and `outcome` are the inputs and targets
of an adaptation method in every domain; the other columns explain how the outcome came about.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from slapshot.parquet import read_table, table_writer, write_table
from slapshot.rollouts.hits import Hits, Outcomes
from slapshot.trajectories.swings import Swings

ROWS_PER_GROUP = 131_072
STATE_SIZE = OUTCOME_SIZE = 2


def _field(name: str, kind: pa.DataType, unit: str) -> pa.Field:
    return pa.field(name, kind, nullable=False, metadata={"unit": unit})


def hits_schema(latent: int) -> pa.Schema:
    """Schema of a table of hits for actions of `latent` dimensions."""
    single = pa.float32()
    return pa.schema(
        [
            _field("condition", pa.int32(), "1"),
            _field("hit", pa.int32(), "1"),
            _field("swing", pa.int32(), "1"),
            _field("state", pa.list_(single, STATE_SIZE), "m"),
            _field("action", pa.list_(single, latent), "1"),
            _field("outcome", pa.list_(single, OUTCOME_SIZE), "m"),
            *(_field(f"start_error_{k}", single, "m") for k in "xy"),
            _field("launch_t", single, "s"),
            *(_field(f"launch_{k}", single, "m") for k in "xy"),
            _field("launch_yaw", single, "rad"),
            *(_field(f"launch_v{k}", single, "m/s") for k in "xy"),
            _field("launch_spin", single, "rad/s"),
            _field("rest_yaw", single, "rad"),
            _field("slide_duration", single, "s"),
        ]
    )


TRACKS_SCHEMA = pa.schema(
    [
        _field("split", pa.dictionary(pa.int8(), pa.string()), "1"),
        _field("condition", pa.int32(), "1"),
        _field("hit", pa.int32(), "1"),
        _field("t", pa.float32(), "s"),
        _field("x", pa.float32(), "m"),
        _field("y", pa.float32(), "m"),
        _field("yaw", pa.float32(), "rad"),
    ]
)


def hits_table(hits: Hits, outcomes: Outcomes, swings: Swings, conditions: range) -> pa.Table:
    """Rows for the hits of consecutive conditions."""
    count = len(hits.swings)
    each = count // len(conditions)
    launch = dict(zip(("x", "y", "yaw", "vx", "vy", "spin"), outcomes.launches.T, strict=True))
    columns = {
        "condition": np.repeat(np.array(conditions), each),
        "hit": np.tile(np.arange(each), len(conditions)),
        "swing": hits.swings,
        "state": swings.starts[hits.swings],
        "action": swings.latents[hits.swings],
        "outcome": outcomes.rests[:, :2],
        "start_error_x": hits.start_errors[:, 0],
        "start_error_y": hits.start_errors[:, 1],
        "launch_t": outcomes.launch_times,
        **{f"launch_{name}": values for name, values in launch.items()},
        "rest_yaw": outcomes.rests[:, 2],
        "slide_duration": outcomes.durations,
    }
    schema = hits_schema(swings.latents.shape[1])
    return pa.table([_array(columns[f.name], f.type) for f in schema], schema=schema)


def tracks_table(split: str, keys: pd.DataFrame, tracks: list[NDArray[np.float64]]) -> pa.Table:
    """Rows for tracks (rows, 4) of t, x, y, yaw; `keys` has their condition and hit."""
    lengths = [len(track) for track in tracks]
    stacked = np.concatenate(tracks) if tracks else np.empty((0, 4))
    columns = {
        "split": pa.array([split] * len(stacked), pa.string())
        .dictionary_encode()
        .cast(pa.dictionary(pa.int8(), pa.string())),
        **{name: np.repeat(keys[name].to_numpy(), lengths) for name in ("condition", "hit")},
        **dict(zip(("t", "x", "y", "yaw"), stacked.T, strict=True)),
    }
    return pa.table([_array(columns[f.name], f.type) for f in TRACKS_SCHEMA], schema=TRACKS_SCHEMA)


def _array(values, kind: pa.DataType) -> pa.Array:  # type: ignore[no-untyped-def]
    if isinstance(values, pa.Array):
        return values
    if pa.types.is_fixed_size_list(kind):
        flat = pa.array(np.ascontiguousarray(values, np.float32).ravel(), kind.value_type)
        return pa.FixedSizeListArray.from_arrays(flat, type=kind)
    return pa.array(np.asarray(values)).cast(kind, safe=False)


def write_atomically(table: pa.Table, path: Path) -> None:
    """Write a Parquet file such that it either is complete or does not exist."""
    aside = path.with_suffix(".tmp")
    write_table(table, aside)
    aside.rename(path)


def concatenate(parts: list[Path], path: Path, schema: pa.Schema) -> None:
    """Join Parquet files in order, in row groups of ROWS_PER_GROUP with one group in memory at a time."""
    with table_writer(path, schema) as writer:
        waiting: list[pa.Table] = []
        for part in parts:
            waiting.append(read_table(part).cast(schema))
            if sum(len(table) for table in waiting) >= ROWS_PER_GROUP:
                joined = pa.concat_tables(waiting)
                writer.write_table(joined.slice(0, ROWS_PER_GROUP))
                waiting = [joined.slice(ROWS_PER_GROUP)]
        for table in waiting:
            if len(table):
                writer.write_table(table)
