"""Check a recording and describe it: python -m slapshot.recordings FOLDER."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.errors import InputError
from slapshot.recordings.describe_signals import describe_signals
from slapshot.recordings.format import Recording
from slapshot.recordings.read import format_version, read_recording
from slapshot.recordings.signal_measures import measure_all
from slapshot.recordings.signals import SIGNAL_FORMAT_VERSION, read_signals
from slapshot.text import printable


def describe(recording: Recording) -> str:
    """A short summary of a recording of hits, one fact a line."""
    origin = "stand-in (simulated), not a real robot" if recording.stand_in else "real robot"
    lines = [f"rig            {recording.rig}: {origin}", f"kind           {recording.kind}"]
    hits_of = recording.hits["object_id"].value_counts()
    lines += [
        f"object         {object_id}: {info.shape}, {info.mass_kg:g} +- {info.mass_sd_kg:g} kg, "
        f"{hits_of.get(object_id, 0)} hits"
        for object_id, info in recording.objects.items()
    ]
    lines.append(f"repeats        {_describe_repeats(recording.hits)}")
    lines.append(f"camera         {_describe_camera(recording)}")
    lines.append(f"duration       {_describe_duration(recording)}")
    return "\n".join(printable(line) for line in lines)  # names of rigs and objects are anybody's


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


def _describe_repeats(hits: pd.DataFrame) -> str:
    counts = hits.groupby(["command_id", "object_id"]).size()
    repeated = counts[counts > 1]
    if repeated.empty:
        return "none"
    text = f"{len(repeated)} commands, {repeated.sum()} hits"
    scatter = rest_point_scatter(hits)
    if np.isnan(scatter):
        return f"{text}, too few rest points for their scatter"
    return f"{text}, rest points scatter {100 * scatter:.1f} cm (standard deviation, x and y)"


def _describe_camera(recording: Recording) -> str:
    rate = f"{recording.camera_rate_hz:g} Hz"
    if recording.tracks is None:
        return f"{rate}, no tracks"
    missing = missing_frames(recording.tracks, recording.camera_rate_hz)
    tracked = recording.tracks["hit"].nunique()
    return f"{rate}, {missing:.1%} of frames missing, {tracked} hits tracked"


def _describe_duration(recording: Recording) -> str:
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Describe the recording that the command line names; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.recordings", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the recording")
    options = parser.parse_args(arguments)
    try:
        if format_version(options.folder) == SIGNAL_FORMAT_VERSION:
            signals = read_signals(options.folder)
            print(describe_signals(signals, measure_all(signals)))
        else:
            print(describe(read_recording(options.folder)))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
