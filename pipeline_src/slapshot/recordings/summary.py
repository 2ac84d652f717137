"""A recording in words: `describe_hits` and `describe_signals`."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from slapshot.recordings.format import Recording
from slapshot.recordings.signal_quality import clock_sampling
from slapshot.recordings.signal_statistics import ChannelStatistics
from slapshot.recordings.signals import SignalRecording
from slapshot.text import printable

_HEADINGS = ("channel", "unit", "from", "to", "step", "noise", "missing", "what")


def describe_hits(recording: Recording) -> str:
    """A short summary of a recording of hits, one fact a line."""
    origin = "stand-in (simulated), not a real robot" if recording.stand_in else "real robot"
    lines = [f"rig            {recording.rig}: {origin}", f"kind           {recording.kind}"]
    hits_of = recording.hits["object_id"].value_counts()
    lines += [
        f"object         {object_id}: {info.shape}, {info.mass_kg:g} +- {info.mass_sd_kg:g} kg, "
        f"{hits_of.get(object_id, 0)} hits"
        for object_id, info in recording.objects.items()
    ]
    lines.append(f"repeats        {_summarise_repeats(recording.hits)}")
    lines.append(f"camera         {_summarise_camera(recording)}")
    lines.append(f"duration       {_summarise_duration(recording)}")
    return "\n".join(printable(line) for line in lines)  # names of rigs and objects are arbitrary


def rest_point_scatter(hits: pd.DataFrame) -> float:
    """Scatter of the rest points of repeated commands in m, NaN without repeats.

    With r_gi the rest point of repeat i of group g (one command and one object), n_g their number:

        scatter^2 = sum_g sum_i |r_gi - mean_i r_gi|^2 / sum_g (n_g - 1)

    Args:
        hits: Table of hits; rest points that were not seen do not count.
    """
    seen = hits[hits["command_id"].notna() & hits["rest_x"].notna()]
    squares, freedom = 0.0, 0
    for _, group in seen.groupby(["command_id", "object_id"]):
        r = group[["rest_x", "rest_y"]].to_numpy()  # (n_g, 2)
        squares += float(np.sum((r - r.mean(axis=0)) ** 2))
        freedom += len(r) - 1
    return float(np.sqrt(squares / freedom)) if freedom else float("nan")


def missing_frames(tracks: pd.DataFrame, camera_rate_hz: float) -> float:
    """Fraction of frames missing between the first and the last that the camera saw of each hit."""
    t = tracks.groupby("hit")["t"]
    expected = float(np.rint((t.max() - t.min()).to_numpy() * camera_rate_hz).sum()) + t.ngroups
    return max(0.0, 1 - len(tracks) / expected)


def _summarise_repeats(hits: pd.DataFrame) -> str:
    counts = hits.groupby(["command_id", "object_id"]).size()
    repeated = counts[counts > 1]
    if repeated.empty:
        return "none"
    text = f"{len(repeated)} commands, {repeated.sum()} hits"
    scatter = rest_point_scatter(hits)
    if np.isnan(scatter):
        return f"{text}, too few rest points for their scatter"
    return f"{text}, rest points scatter {100 * scatter:.1f} cm (standard deviation, x and y)"


def _summarise_camera(recording: Recording) -> str:
    rate = f"{recording.camera_rate_hz:g} Hz"
    if recording.tracks is None:
        return f"{rate}, no tracks"
    missing = missing_frames(recording.tracks, recording.camera_rate_hz)
    tracked = recording.tracks["hit"].nunique()
    return f"{rate}, {missing:.1%} of frames missing, {tracked} hits tracked"


def _summarise_duration(recording: Recording) -> str:
    tables = (recording.tracks, recording.commands, recording.joints)
    timed = [table.groupby("hit")["t"].max() for table in tables if table is not None]
    if not timed:
        return "not known (no tracks, commands or joints)"
    of_hit = pd.concat(timed).groupby(level=0).max()
    text = f"{of_hit.sum():.1f} s in {len(of_hit)} hits, {of_hit.median():.2f} s a hit (median)"
    when = recording.hits["recorded_at"].dropna()
    if when.empty:
        return text
    return f"{text}, {when.min():%Y-%m-%d %H:%M} to {when.max():%Y-%m-%d %H:%M} UTC"


def describe_signals(recording: SignalRecording, channels: Mapping[str, ChannelStatistics]) -> str:
    """A short summary, one fact a line, and a table of the channels.

    Args:
        recording: that has passed its checks.
        channels: name -> statistics, for every channel.
    """
    origin = "stand-in (simulated), not a real robot" if recording.stand_in else "real robot"
    lines = [f"rig            {recording.rig}: {origin}", f"kind           {_count_roles(recording)}"]
    lines.append(f"episodes       {_summarise_episodes(recording)}")
    lines += [f"clock          {clock}: {_summarise_clock(recording, clock)}" for clock in recording.signals]
    lines += _aligned([_HEADINGS, *(_row(recording, measured) for measured in channels.values())])
    return "\n".join(printable(line) for line in lines)  # names of rigs and channels are arbitrary


def _count_roles(recording: SignalRecording) -> str:
    roles = [channel.role for channel in recording.channels.values()]
    controls = roles.count("control")
    return f"signals: {len(roles) - controls} observed, {controls or 'none'} controlled"


def _summarise_episodes(recording: SignalRecording) -> str:
    spans = [table.groupby("episode")["t"].max() for table in recording.signals.values()]
    last = np.maximum.reduce([span.to_numpy() for span in spans])
    text = f"{len(last)}, {last.sum():.1f} s, {np.median(last):.3g} s an episode (median)"
    repeats = int(recording.episodes["repeat_of"].notna().sum())
    text += f", {repeats} of them repeats" if repeats else ""
    when = recording.episodes["recorded_at"].dropna()
    if when.empty:
        return text
    return f"{text}, {when.min():%Y-%m-%d %H:%M} to {when.max():%Y-%m-%d %H:%M} UTC"


def _summarise_clock(recording: SignalRecording, clock: str) -> str:
    found = clock_sampling(recording, clock)
    rows = len(recording.signals[clock])
    if np.isnan(found.interval_s):
        return f"{rows} samples, one an episode"
    gap = f", longest gap {found.longest_gap_s:.2g} s" if found.longest_gap_s else ""
    return (
        f"{1 / found.interval_s:.4g} Hz, {rows} samples, intervals scatter by {found.jitter:.1%}, "
        f"{found.missing:.1%} missing{gap}"
    )


def _row(recording: SignalRecording, measured: ChannelStatistics) -> tuple[str, ...]:
    channel, values = measured.channel, measured.samples
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


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table whose columns stand below each other; the last may be as long as it likes."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    ]
