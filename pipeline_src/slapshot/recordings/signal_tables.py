"""Tables of a recording of signals: schemas, and frames of exactly their columns and types."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import pyarrow as pa

from slapshot.recordings.channels import Channel
from slapshot.recordings.format import HEADER_FILE, column
from slapshot.recordings.tables import conform, table_from_frame

EPISODES_FILE = "episodes.parquet"
_PREFIX, _SUFFIX = "signals-", ".parquet"

EPISODES_SCHEMA = pa.schema(
    [
        column("episode", pa.int64(), "", "number of the episode, unique"),
        column("order", pa.int64(), "1", "place of the episode in the order of execution"),
        column("recorded_at", pa.timestamp("us", "UTC"), "", "when the episode began", True),
        column("repeat_of", pa.int64(), "", "an episode of which this one is a repeat", True),
    ]
)
_OPTIONAL = frozenset({"recorded_at", "repeat_of"})  # a file may leave these out


def signals_file(clock: str) -> str:
    """Name of a clock's file."""
    return f"{_PREFIX}{clock}{_SUFFIX}"


def clock_of(file: str) -> str | None:
    """The clock whose file has that name; None of other files."""
    if file.startswith(_PREFIX) and file.endswith(_SUFFIX):
        return file[len(_PREFIX) : -len(_SUFFIX)]
    return None


def clocks(channels: Mapping[str, Channel]) -> dict[str, list[str]]:
    """Clock -> names of its channels, both in the order of `channels`."""
    found: dict[str, list[str]] = {}
    for name, channel in channels.items():
        found.setdefault(channel.clock, []).append(name)
    return found


def signals_schema(channels: Mapping[str, Channel], clock: str) -> pa.Schema:
    """Schema of a clock's table."""
    return pa.schema(
        [
            column("episode", pa.int64(), "", "number of the episode"),
            column("t", pa.float64(), "s", "time from the episode's start"),
            *(
                column(name, pa.float64(), channels[name].unit, channels[name].of, True)
                for name in clocks(channels)[clock]
            ),
        ]
    )


def conform_episodes(table: pa.Table, file: Path) -> pa.Table:
    """The table of episodes in its types.

    Raises:
        InputError: If a column is missing, unknown, of the wrong type or has a bad value.
    """
    return conform(table, EPISODES_SCHEMA, file, _OPTIONAL)


def conform_signals(table: pa.Table, channels: Mapping[str, Channel], clock: str, file: Path) -> pa.Table:
    """A clock's table in its types, rows of one episode side by side in the order that they had.

    Raises:
        InputError: If a column is missing, unknown, of the wrong type or has a bad value.
    """
    unknown = f"describe it as a channel of clock {clock!r} in {HEADER_FILE}, or remove it"
    conformed = conform(table, signals_schema(channels, clock), file, (), unknown)
    episode = conformed.column("episode").to_pandas()
    if episode.is_monotonic_increasing:
        return conformed
    return conformed.take(episode.argsort(kind="stable").to_numpy())


def conform_frame(frame: pd.DataFrame, channels: Mapping[str, Channel], file: Path) -> pa.Table:
    """A DataFrame as the table that stands in `file`.

    Raises:
        InputError: As `conform_episodes` and `conform_signals`.
    """
    table = table_from_frame(frame, file)
    clock = clock_of(file.name)
    return conform_episodes(table, file) if clock is None else conform_signals(table, channels, clock, file)
