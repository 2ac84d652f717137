"""From CSV files to a recording of signals: `import_signals`."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.json_types import JsonObject
from slapshot.recordings.importing.files import fields_of_names, find_sources, natural_key
from slapshot.recordings.importing.rows import Rows, read_rows
from slapshot.recordings.importing.signal_mapping import (
    EPISODE,
    ClockColumns,
    SignalMapping,
    load_signal_mapping,
)
from slapshot.recordings.importing.track_importer import write_sources
from slapshot.recordings.signals import SignalRecording, write_signals
from slapshot.recordings.write import check_new
from slapshot.validation import short

_EPISODE_FIELD = "episode"  # of a file's name


@dataclass(frozen=True)
class SignalSummary:
    """What an import did.

    Attributes:
        out: folder of the recording.
        episodes: how many it has.
        samples: rows of all clocks together.
        lines: notes for the user, one line each.
    """

    out: Path
    episodes: int
    samples: int
    lines: tuple[str, ...]


@dataclass(frozen=True)
class _Part:
    """Rows of one clock in one episode.

    Attributes:
        source: file, for messages.
        lines: (n,) lines of the rows in the file.
        t: (n,) s, of the file's zero.
        columns: channel -> (n,) in SI, NaN where missing.
        remarks: what was left out, in words.
    """

    source: str
    lines: NDArray[np.int64]
    t: Array
    columns: dict[str, Array]
    remarks: tuple[str, ...] = ()

    def where(self, keep: NDArray[np.bool_], *remarks: str) -> "_Part":
        """Some of the rows."""
        return replace(
            self,
            lines=self.lines[keep],
            t=self.t[keep],
            columns={name: values[keep] for name, values in self.columns.items()},
            remarks=(*self.remarks, *remarks),
        )


def import_signals(mapping: Path, source: Path, out: Path) -> SignalSummary:
    """Make a recording of the signals in CSV files.

    Args:
        mapping: YAML file, see `SignalMapping`.
        source: a folder of CSV files, one of them, or a path with * in it.
        out: folder of the recording; must not exist yet.

    Raises:
        InputError: The mapping or a file cannot be used, or `out` exists.
    """
    check_new(out)  # before hours of reading, not after
    rules = load_signal_mapping(mapping)
    parts = {clock: _read_clock(ClockColumns(rules, clock), source) for clock in rules.clocks}
    names = _same_episodes(parts, rules)
    episodes = [_common_zero({clock: of[name] for clock, of in parts.items()}, rules) for name in names]
    write_signals(_recording(rules, episodes), out)
    lines = [
        f"episode {number}, {part.source}: {remark}"
        for number, episode in enumerate(episodes)
        for part in episode.values()
        for remark in part.remarks
    ]
    write_sources(out, {"lines": lines, "episodes": [_sources(episode) for episode in episodes]})
    samples = sum(len(part.t) for episode in episodes for part in episode.values())
    return SignalSummary(out, len(episodes), samples, tuple(lines))


def _read_clock(columns: ClockColumns, source: Path) -> dict[str, _Part]:
    """Name of an episode -> rows of the clock, in natural order of the names.

    Episodes are called as the field "episode" of the file's name, or numbered in the order of the files; and
    as the column that identifies them.
    """
    root, files = find_sources(columns.rules.files, source)
    pattern = columns.mapping.name_pattern(columns.clock)
    found: dict[str, _Part] = {}
    for number, (file, fields) in enumerate(zip(files, fields_of_names(pattern, files), strict=True)):
        of_file = fields.get(_EPISODE_FIELD, str(number) if len(files) > 1 else "")
        rows = read_rows(columns, file)
        label = file.relative_to(root).as_posix()
        texts = np.array(rows.texts.get(EPISODE, [""] * len(rows.lines)))
        for text in dict.fromkeys(texts.tolist()):
            name = "/".join(part for part in (of_file, text) if part)
            if name in found:
                raise InputError(
                    f"{file}: episode {short(name)} stands in {found[name].source}, too; let "
                    "files.name_pattern distinguish them, or name a column as episode"
                )
            found[name] = _part(columns, rows, np.flatnonzero(texts == text), label, of_file != name)
    return {name: found[name] for name in sorted(found, key=natural_key)}


def _part(columns: ClockColumns, rows: Rows, which: NDArray[np.int64], label: str, of_column: bool) -> _Part:
    numbers = {role: values[which] for role, values in rows.numbers.items()}
    rate = columns.rules.time.rate_hz
    t = numbers["t"] if rate is None else np.arange(len(which)) / rate
    part = _Part(label, rows.lines[which], t, {name: numbers[name] for name in columns.names})
    seen = ~np.isnan(t) & ~np.all([np.isnan(values) for values in part.columns.values()], axis=0)
    if not seen.all():
        part = part.where(seen, f"{(~seen).sum()} of {len(seen)} rows have no time or no value")
    if rows.cut_short and which[-1] == len(rows.lines) - 1:
        part = part.where(np.ones(len(part.t), dtype=bool), "its last line is cut short and was left out")
    if not len(part.t):
        raise InputError(
            f"{rows.file}: has no row with a time and a value; correct the columns in {columns.file}"
        )
    part = _with_all_controls(columns, rows.file, part)
    return _unwrapped(columns, _increasing(columns, rows.file, part, of_column))


def _with_all_controls(columns: ClockColumns, file: Path, part: _Part) -> _Part:
    """The rows from the first on in which all controls of the clock are given.

    Raises:
        InputError: One is empty in a later row.
    """
    channels = columns.mapping.channels
    controls = [name for name in part.columns if channels[name].role == "control"]
    empty = np.zeros(len(part.t), dtype=bool)
    for name in controls:
        empty |= np.isnan(part.columns[name])
    if not empty.any():
        return part
    given = np.flatnonzero(~empty)
    later = given[0] + np.flatnonzero(empty[given[0] :]) if len(given) else np.flatnonzero(empty)
    if len(later):
        name = next(name for name in controls if np.isnan(part.columns[name][later[0]]))
        raise InputError(
            f"{file}: line {part.lines[later[0]]}: control {name!r} is empty: fill in what was given then, "
            "or put it on a clock of its own, which may have the same files"
        )
    return part.where(~empty, f"{given[0]} rows stand before all controls were given and were left out")


def _unwrapped(columns: ClockColumns, part: _Part) -> _Part:
    """The same, with columns that begin again after a period continued across it."""
    values = dict(part.columns)
    for name, column in part.columns.items():
        period = columns.mapping.channels[name].wrap_period
        if period is not None:
            seen = ~np.isnan(column)
            values[name] = column.copy()
            values[name][seen] = np.unwrap(column[seen], period=period)
    return replace(part, columns=values)


def _increasing(columns: ClockColumns, file: Path, part: _Part, of_column: bool) -> _Part:
    """The rows in which time increases; of rows with the same time, the one that the mapping wants.

    Raises:
        InputError: Time goes backwards, or stands still and the mapping does not say what to do.
    """
    repeats = columns.rules.time.repeats
    step = np.diff(part.t)
    wrong = np.flatnonzero(step < 0 if repeats != "refuse" else step <= 0)
    if wrong.size:
        before, after = wrong[0], wrong[0] + 1
        same = part.t[after] == part.t[before]
        problem = "the same time twice" if same else "time goes backwards"
        remedy = "say repeats: keep_last under time" if same else "correct the lines"
        column = "" if of_column else ", or name the column that identifies episodes"
        raise InputError(
            f"{file}: line {part.lines[after]}: {problem} ({part.t[before]:.10g} s in line "
            f"{part.lines[before]}, then {part.t[after]:.10g} s); {remedy}{column}"
        )
    again = step == 0
    if not again.any():
        return part
    keep = np.append(~again, True) if repeats == "keep_last" else np.insert(~again, 0, True)
    return part.where(keep, f"{again.sum()} rows repeat the time of another and were left out")


def _same_episodes(parts: Mapping[str, dict[str, _Part]], rules: SignalMapping) -> list[str]:
    """Names of the episodes, in order; all clocks must have the same."""
    first, *others = parts
    for other in others:
        for a, b in ((first, other), (other, first)):
            lacking = [name for name in parts[a] if name not in parts[b]]
            if lacking:
                raise InputError(
                    f"{rules.where('clocks', b)}: has no episode {short(lacking[0])}, which clock {a!r} has "
                    f"in {parts[a][lacking[0]].source}; add its file, or let (?P<episode>...) in "
                    "files.name_pattern name them"
                )
    return list(parts[first])


def _common_zero(episode: dict[str, _Part], rules: SignalMapping) -> dict[str, _Part]:
    """All clocks from the episode's start, without what was observed before all controls were given.

    The episode starts with the first observation, or where the control that holds then was given.

    Raises:
        InputError: A clock ends before the controls begin.
    """
    roles = {clock: {c.role for c in rules.channels.values() if c.clock == clock} for clock in episode}
    parts = dict(episode)
    observing = [clock for clock in parts if "observation" in roles[clock]]
    controlling = [clock for clock in parts if "control" in roles[clock]]
    while True:  # what a clock with both loses may make its controls begin later than others observe
        begin = max((float(parts[clock].t[0]) for clock in controlling), default=-np.inf)
        early = [clock for clock in observing if parts[clock].t[0] < begin]
        if not early:
            break
        for clock in early:
            part = parts[clock]
            if part.t[-1] < begin:
                raise InputError(
                    f"{part.source}: ends at {part.t[-1]:.10g} s, before controls begin at {begin:.10g} s; "
                    "give all clocks the same zero"
                )
            count = int((part.t < begin).sum())
            parts[clock] = part.where(
                part.t >= begin, f"{count} rows stand before all controls were given and were left out"
            )
    first = min(float(parts[clock].t[0]) for clock in observing)
    for clock in set(controlling) - set(observing):
        part = parts[clock]
        held = float(part.t[part.t <= first][-1])
        if part.t[0] < held:
            count = int((part.t < held).sum())
            parts[clock] = part.where(
                part.t >= held, f"{count} controls before the first observation were left out"
            )
    zero = min(float(part.t[0]) for part in parts.values())
    return {clock: replace(part, t=part.t - zero) for clock, part in parts.items()}


def _recording(rules: SignalMapping, episodes: list[dict[str, _Part]]) -> SignalRecording:
    number = np.arange(len(episodes))
    signals = {}
    for clock in rules.clocks:
        frames = [
            pd.DataFrame({"episode": i, "t": episode[clock].t, **episode[clock].columns})
            for i, episode in enumerate(episodes)
        ]
        signals[clock] = pd.concat(frames, ignore_index=True)
    return SignalRecording(
        rig=rules.rig,
        stand_in=rules.stand_in,
        note=rules.note,
        sealed_truth_sha256=None,
        channels={name: channel.recorded for name, channel in rules.channels.items()},
        episodes=pd.DataFrame({"episode": number, "order": number}),
        signals=signals,
    )


def _sources(episode: Mapping[str, _Part]) -> JsonObject:
    """Clock -> the lines of the file that its rows are from."""
    return {
        clock: {"source": part.source, "first_line": int(part.lines[0]), "last_line": int(part.lines[-1])}
        for clock, part in episode.items()
    }
