"""The recording format, version 2: joints and bodies of any MuJoCo model; one folder, SI units, radians.

| file                    | one row is                     | columns                                         |
|-------------------------|--------------------------------|-------------------------------------------------|
| recording.json          |                                | see header.SignalHeader and channels.Channel    |
| episodes.parquet        | one episode                    | see signal_tables.EPISODES_SCHEMA               |
| signals-<clock>.parquet | one moment of an episode, in s | episode, t, and one a channel of the clock;     |
|                         | from the episode's start       | null or NaN where an observation is missing     |

An episode is a stretch of time that was recorded without a break and can be simulated by itself. Quantities
that are sampled together share a clock, and so a table; each clock has rows of every episode. Controls have
no gap and begin no later than the observations. Without controls a recording shows passive
bodies. Version 1, for hits of a sliding object, is defined in `format`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.recordings.channels import Channel
from slapshot.recordings.format import HEADER_FILE
from slapshot.recordings.header import SignalHeader, check_header, read_header
from slapshot.recordings.read import check_folder
from slapshot.recordings.signal_checks import check_signals
from slapshot.recordings.signal_tables import (
    EPISODES_FILE,
    clock_of,
    clocks,
    conform_episodes,
    conform_frame,
    conform_signals,
    signals_file,
)
from slapshot.recordings.tables import frame_from_table, read_parquet
from slapshot.recordings.write import check_new, write_files

SIGNAL_FORMAT_VERSION = 2


# No generated equality: comparing two DataFrames with == gives a table, not an answer.
@dataclass(frozen=True, eq=False)
class SignalRecording:
    """A recording of joints and bodies.

    Attributes:
        rig: name of the physical set-up.
        stand_in: True for a simulated stand-in, False for a real robot.
        note: free text.
        sealed_truth_sha256: digest of the file that holds a stand-in's concealed physics.
        channels: name -> what is recorded in the column of that name.
        episodes: one row an episode: episode (int64), order (int64), recorded_at (timestamp, NaT where not
            known), repeat_of (Int64, null where it is no repeat).
        signals: clock -> table: episode (int64), t (float64, s from the episode's start, strictly increasing
            in an episode), one float64 column a channel of that clock (NaN: missing). Rows of one episode
            are side by side, episodes in ascending order.
    """

    rig: str
    stand_in: bool
    note: str
    sealed_truth_sha256: str | None
    channels: dict[str, Channel]
    episodes: pd.DataFrame
    signals: dict[str, pd.DataFrame]

    @classmethod
    def from_arrays(
        cls,
        t: Array | Sequence[Array],
        channels: Mapping[str, tuple[Channel, Array | Sequence[Array]]],
        rig: str,
        *,
        stand_in: bool = False,
        note: str = "",
    ) -> "SignalRecording":
        """A recording with one clock from arrays, checked as reading would.

        Args:
            t: (n,) s from the episode's start, or one such array an episode.
            channels: name -> channel, and its values: (n,), or one such array an episode.
            rig: name of the physical set-up.
            stand_in: True for a simulated stand-in.
            note: free text.

        Raises:
            InputError: one line: lengths differ, there are several clocks, or what reading would refuse.
        """
        times = _episodes_of(t, "t")
        names = {channel.clock for channel, _ in channels.values()}
        if len(names) > 1:
            raise InputError(
                f"channels: are on several clocks ({', '.join(sorted(names))}), and t is one: give them one, "
                "or make the tables yourself"
            )
        columns: dict[str, Any] = {
            "episode": np.repeat(np.arange(len(times)), [len(moments) for moments in times]),
            "t": np.concatenate(times),
        }
        for name, (_, values) in channels.items():
            parts = _episodes_of(values, name)
            if [len(part) for part in parts] != [len(moments) for moments in times]:
                raise InputError(
                    f"channels: {name}: has lengths {[len(part) for part in parts][:5]}, but t "
                    f"{[len(moments) for moments in times][:5]}: give one value a moment of each episode"
                )
            columns[name] = np.concatenate(parts)
        number = np.arange(len(times))
        recording = cls(
            rig=rig,
            stand_in=stand_in,
            note=note,
            sealed_truth_sha256=None,
            channels={name: channel for name, (channel, _) in channels.items()},
            episodes=pd.DataFrame({"episode": number, "order": number}),
            signals={clock: pd.DataFrame(columns) for clock in names},
        )
        return _frames(recording, _checked(recording, Path())[1])


def read_signals(folder: Path) -> SignalRecording:
    """Read and check a recording of signals.

    Args:
        folder: Folder in version 2 of the format; files of other names are ignored.

    Raises:
        InputError: If anything is missing, damaged or implausible; one line for a person.
    """
    folder = Path(folder)
    check_folder(folder)
    header = read_header(folder / HEADER_FILE, SignalHeader)
    wanted = clocks(header.channels)
    for path in sorted(folder.iterdir()):
        clock = clock_of(path.name)
        if clock is not None and clock not in wanted:
            raise InputError(
                f"{path}: no channel in {HEADER_FILE} is on clock {clock!r}: describe its columns there, or "
                "remove the file"
            )
    episodes = conform_episodes(
        _read(folder / EPISODES_FILE, "the table of episodes"), folder / EPISODES_FILE
    )
    signals = {}
    for clock, names in wanted.items():
        file = folder / signals_file(clock)
        table = _read(file, f"a table with columns episode, t, {', '.join(names)}")
        signals[clock] = conform_signals(table, header.channels, clock, file)
    recording = SignalRecording(
        **header.fields,
        episodes=frame_from_table(episodes),
        signals={clock: frame_from_table(table) for clock, table in signals.items()},
    )
    check_signals(recording.channels, recording.episodes, recording.signals, folder)
    return recording


def write_signals(recording: SignalRecording, folder: Path) -> None:
    """Check a recording as reading would, then write it, whole or not at all.

    Args:
        recording: Its tables may have columns in any order, and rows of episodes interleaved.
        folder: Must not exist yet; its parents are made where needed.

    Raises:
        InputError: If a check fails, the folder exists or cannot be written.
    """
    folder = Path(folder)
    check_new(folder)
    header, tables = _checked(recording, folder)
    write_files(header.to_json(), tables, folder)


def _checked(recording: SignalRecording, folder: Path) -> tuple[SignalHeader, dict[str, pa.Table]]:
    """Header and tables by file name, in the format's types, after all checks."""
    values = {
        name: getattr(recording, name)
        for name in SignalHeader.model_fields
        if name not in {"format_version", "channels"}
    }
    channels = {
        name: channel.model_dump(exclude_defaults=True) for name, channel in recording.channels.items()
    }
    header = check_header(
        {"format_version": SIGNAL_FORMAT_VERSION, **values, "channels": channels},
        folder / HEADER_FILE,
        SignalHeader,
    )
    wanted = clocks(header.channels)
    for clock in [*wanted, *recording.signals]:
        if clock not in recording.signals or clock not in wanted:
            problem = "has no table" if clock in wanted else "has no channel"
            raise InputError(
                f"{folder / signals_file(clock)}: clock {clock!r} {problem}: add it, or remove the clock"
            )
    frames = {EPISODES_FILE: recording.episodes}
    frames |= {signals_file(clock): recording.signals[clock] for clock in wanted}
    tables = {name: conform_frame(frame, header.channels, folder / name) for name, frame in frames.items()}
    as_read = _frames(recording, tables)
    check_signals(header.channels, as_read.episodes, as_read.signals, folder)
    return header, tables


def _frames(recording: SignalRecording, tables: Mapping[str, pa.Table]) -> SignalRecording:
    """The recording with the frames of tables that have been checked."""
    frames = {name: frame_from_table(table) for name, table in tables.items()}
    signals = {clock: frames[signals_file(clock)] for clock in clocks(recording.channels)}
    return dataclasses.replace(recording, episodes=frames[EPISODES_FILE], signals=signals)


def _read(file: Path, what: str) -> pa.Table:
    if not file.exists() and not file.is_symlink():
        raise InputError(f"{file}: is missing: add {what}")
    return read_parquet(file)


def _episodes_of(values: Array | Sequence[Array], name: str) -> list[Array]:
    """One array an episode, whichever way the values are given.

    Raises:
        InputError: They are no numbers, or have more dimensions.
    """
    try:
        several = isinstance(values, Sequence) and len(values) > 0 and np.ndim(values[0]) > 0
        parts = [np.asarray(part, np.float64) for part in (values if several else [values])]
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: holds what is no number ({error}): give arrays of floats") from None
    if not parts or any(part.ndim != 1 for part in parts):
        raise InputError(f"{name}: is no array of shape (n,), nor a list of such: give one array an episode")
    return parts
