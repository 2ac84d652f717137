"""Validity checks of a recording of signals beyond its columns' types and units, one function for each check.

As in `checks`, each takes tables in the format's types and raises InputError with one line. Rows are counted
from 0, as pandas does, in the order of episodes.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.errors import InputError
from slapshot.recordings.channels import Channel, Role, quaternions
from slapshot.recordings.checks import check_shows_motion, check_timed_rows
from slapshot.recordings.plausibility import check_begin, check_dates, check_possible
from slapshot.recordings.signal_tables import EPISODES_FILE, clocks, signals_file

# Beyond any rig, in any SI unit: uninitialised memory.
_IMPOSSIBLE = 1e9
_MAX_EPISODES = 100_000
# Joint motion sampled less than twice per second: times are in another unit, milliseconds at 1 or 2 kHz.
_MIN_RATE_HZ = 2.0
_MAX_CONTROL_RATIO = 100.0  # controls longer than the observations by this factor are in another unit
_UNIT_NORM = 0.05


def check_signals(
    channels: Mapping[str, Channel],
    episodes: pd.DataFrame,
    signals: Mapping[str, pd.DataFrame],
    folder: Path,
) -> None:
    """Run every check on the tables of a recording of signals.

    Args:
        channels: That have been checked.
        episodes: Table of the format's columns and types.
        signals: Clock -> such a table.
        folder: Where it lies or will lie, to name files in errors.

    Raises:
        InputError: On the first check that fails.
    """
    check_episodes(episodes, folder / EPISODES_FILE)
    roles = {clock: {channels[name].role for name in names} for clock, names in clocks(channels).items()}
    for clock, names in clocks(channels).items():
        table, file = signals[clock], folder / signals_file(clock)
        check_timed_rows(table, episodes["episode"], file, "episode", EPISODES_FILE)
        check_begin(table, file, "episode")
        check_all_episodes(table, episodes, file)
        if "observation" in roles[clock]:
            check_shows_motion(table, file, "episode")
            check_interval(table, file)
        check_possible(table, names, _IMPOSSIBLE, "anything in SI units", file, "episode")
        check_values(table, {name: channels[name] for name in names}, file)
    for names in quaternions(channels):
        clock = channels[names[0]].clock
        check_unit_norm(signals[clock], names, folder / signals_file(clock))
    check_times_together(signals, roles, folder)


def check_episodes(episodes: pd.DataFrame, file: Path) -> None:
    """Refuse a table without episodes, numbers that stand twice, impossible dates, repeats of nothing."""
    if episodes.empty:
        raise InputError(f"{file}: has no episodes: record some")
    if len(episodes) > _MAX_EPISODES:
        raise InputError(
            f"{file}: has {len(episodes):,} episodes, and {_MAX_EPISODES:,} are allowed: split it"
        )
    numbers = episodes["episode"]
    second = numbers.duplicated().to_numpy()
    if second.any():
        row = int(np.flatnonzero(second)[0])
        raise InputError(
            f"{file}: row {row} (the first is 0): episode {numbers.iloc[row]} is duplicated: give every "
            "episode its own number"
        )
    check_dates(episodes, file, "episode")
    repeats = episodes["repeat_of"]
    wrong = (repeats.notna() & (~repeats.isin(numbers) | (repeats == numbers).fillna(False))).to_numpy()
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{file}: row {row} (the first is 0), episode {numbers.iloc[row]}: repeat_of is "
            f"{repeats.iloc[row]}, which is no other episode of this table: correct it, or use null"
        )


def check_all_episodes(table: pd.DataFrame, episodes: pd.DataFrame, file: Path) -> None:
    """Refuse a clock that lacks an episode."""
    lacking = episodes["episode"][~episodes["episode"].isin(table["episode"])]
    if len(lacking):
        raise InputError(
            f"{file}: has no rows of episode {lacking.iloc[0]}: add them, or remove that episode from "
            f"{EPISODES_FILE} and every clock"
        )


def check_interval(table: pd.DataFrame, file: Path) -> None:
    """Refuse sampling intervals so long that times must be in another unit."""
    interval = float(np.nanmedian(table.groupby("episode")["t"].diff().to_numpy()))
    if interval * _MIN_RATE_HZ >= 1:
        raise InputError(
            f"{file}: column 't': samples are {interval:.4g} apart (median), too rare for seconds: if t is "
            "in milliseconds, divide by 1000; if in microseconds, by 1e6"
        )


def check_values(table: pd.DataFrame, channels: Mapping[str, Channel], file: Path) -> None:
    """Refuse controls with missing values, and observations without any."""
    for name, channel in channels.items():
        missing = table[name].isna().to_numpy()
        if channel.role == "control" and missing.any():
            row = int(np.flatnonzero(missing)[0])
            raise InputError(
                f"{file}: row {row} (the first is 0), episode {table['episode'].iloc[row]}: control {name!r} "
                "is empty (null or NaN): fill in what was given then, or put it on a clock of its own"
            )
        if missing.all():
            raise InputError(
                f"{file}: channel {name!r} has no value in any row: record it, or remove the channel"
            )
    observed = [name for name, channel in channels.items() if channel.role == "observation"]
    if observed:
        blind = table[observed].isna().all(axis=1).groupby(table["episode"]).all()
        if blind.any():
            raise InputError(
                f"{file}: episode {blind.index[blind][0]} has no observation on this clock (all are null or "
                "NaN): leave the episode out"
            )


def check_unit_norm(table: pd.DataFrame, names: list[str], file: Path) -> None:
    """Refuse quaternions that are not of unit norm."""
    norm = np.linalg.norm(table[names].to_numpy(), axis=1)
    seen = norm[~np.isnan(norm)]
    typical = float(np.median(seen)) if len(seen) else 1.0
    if abs(typical - 1) > _UNIT_NORM:
        raise InputError(
            f"{file}: quaternion {', '.join(names)} has a length of {typical:.4g} (median), not 1: check its "
            "columns, or divide by the length"
        )


def check_times_together(
    signals: Mapping[str, pd.DataFrame], roles: Mapping[str, set[Role]], folder: Path
) -> None:
    """Refuse clocks that do not run at the same time, and observations before the first control.

    Args:
        signals: Clock -> table.
        roles: Clock -> roles of its channels.
        folder: To name files in errors.
    """
    spans = {clock: table.groupby("episode")["t"].agg(["min", "max"]) for clock, table in signals.items()}
    observing = [clock for clock in signals if "observation" in roles[clock]]
    for i, clock in enumerate(observing):
        for other in observing[:i]:
            _check_overlap(spans[other], spans[clock], other, folder / signals_file(clock))
    begin = pd.concat([spans[clock]["min"] for clock in observing], axis=1).min(axis=1)
    end = pd.concat([spans[clock]["max"] for clock in observing], axis=1).max(axis=1)
    for clock in (clock for clock in signals if "control" in roles[clock]):
        file = folder / signals_file(clock)
        late = spans[clock]["min"] > begin
        if late.any():
            episode = late.index[late][0]
            raise InputError(
                f"{file}: episode {episode}: controls begin at {spans[clock].loc[episode, 'min']:.6g} s, but "
                f"observations at {begin[episode]:.6g} s: give what was controlled from there on, or leave "
                "earlier observations out"
            )
        several = signals[clock].groupby("episode").size() > 1
        over = several & (spans[clock]["max"] < begin)
        endless = spans[clock]["max"] > _MAX_CONTROL_RATIO * end.clip(lower=1e-3)
        for wrong in (over, endless):
            if wrong.any():
                episode = wrong.index[wrong][0]
                first, last = spans[clock].loc[episode]
                raise InputError(
                    f"{file}: episode {episode}: controls are given from {first:.6g} to {last:.6g} s, but "
                    f"observations from {begin[episode]:.6g} to {end[episode]:.6g} s: give all clocks the "
                    "same zero, in seconds"
                )


def _check_overlap(a: pd.DataFrame, b: pd.DataFrame, name: str, file: Path) -> None:
    """Refuse two clocks that share no moment of an episode.

    Args:
        a: Columns min and max of t, by episode.
        b: The same of the second clock.
        name: Of the first clock.
        file: Of the second.
    """
    apart = (a["min"] > b["max"]) | (b["min"] > a["max"])
    if apart.any():
        episode = apart.index[apart][0]
        raise InputError(
            f"{file}: episode {episode}: goes from {b.loc[episode, 'min']:.6g} to "
            f"{b.loc[episode, 'max']:.6g} s, but clock {name!r} from {a.loc[episode, 'min']:.6g} to "
            f"{a.loc[episode, 'max']:.6g} s: give all clocks the same zero, in seconds"
        )
