"""A recording of signals in words: `describe_signals`."""

from collections.abc import Mapping, Sequence

import numpy as np

from slapshot.recordings.signal_measures import Measured
from slapshot.recordings.signal_quality import clock_sampling
from slapshot.recordings.signals import SignalRecording
from slapshot.text import printable

_HEADINGS = ("channel", "unit", "from", "to", "step", "noise", "missing", "what")


def describe_signals(recording: SignalRecording, channels: Mapping[str, Measured]) -> str:
    """A short summary, one fact a line, and a table of the channels.

    Args:
        recording: that has passed its checks.
        channels: name -> measure of the channel, of all of them.
    """
    origin = "stand-in (simulated), not a real robot" if recording.stand_in else "real robot"
    lines = [f"rig            {recording.rig}: {origin}", f"kind           {_kind(recording)}"]
    lines.append(f"episodes       {_describe_episodes(recording)}")
    lines += [f"clock          {clock}: {_describe_clock(recording, clock)}" for clock in recording.signals]
    lines += _table([_HEADINGS, *(_row(recording, measured) for measured in channels.values())])
    return "\n".join(printable(line) for line in lines)  # names of rigs and channels are anybody's


def _kind(recording: SignalRecording) -> str:
    roles = [channel.role for channel in recording.channels.values()]
    controls = roles.count("control")
    return f"signals: {len(roles) - controls} observed, {controls or 'none'} controlled"


def _describe_episodes(recording: SignalRecording) -> str:
    spans = [table.groupby("episode")["t"].max() for table in recording.signals.values()]
    last = np.maximum.reduce([span.to_numpy() for span in spans])
    text = f"{len(last)}, {last.sum():.1f} s, {np.median(last):.3g} s an episode (median)"
    repeats = int(recording.episodes["repeat_of"].notna().sum())
    text += f", {repeats} of them repeats" if repeats else ""
    when = recording.episodes["recorded_at"].dropna()
    if when.empty:
        return text
    return f"{text}, {when.min():%Y-%m-%d %H:%M} to {when.max():%Y-%m-%d %H:%M} UTC"


def _describe_clock(recording: SignalRecording, clock: str) -> str:
    found = clock_sampling(recording, clock)
    rows = len(recording.signals[clock])
    if np.isnan(found.interval_s):
        return f"{rows} samples, one an episode"
    gap = f", longest gap {found.longest_gap_s:.2g} s" if found.longest_gap_s else ""
    return (
        f"{1 / found.interval_s:.4g} Hz, {rows} samples, intervals scatter by {found.jitter:.1%}, "
        f"{found.missing:.1%} missing{gap}"
    )


def _row(recording: SignalRecording, measured: Measured) -> tuple[str, ...]:
    channel, values = measured.channel, measured.values
    rows = len(recording.signals[channel.clock])
    return (
        measured.name,
        channel.unit,
        f"{values.min():.4g}",
        f"{values.max():.4g}",
        "" if np.isnan(measured.step) else f"{measured.step:.3g}",
        "" if np.isnan(measured.noise) or channel.role == "control" else f"{measured.noise:.2g}",
        f"{1 - len(values) / rows:.1%}",
        f"{channel.role}, {channel.of}",
    )


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table whose columns stand below each other; the last may be as long as it likes."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    ]
