"""What `slapshot import` and `slapshot check` do and print."""

import argparse
from pathlib import Path

from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.importing.signal_importer import SignalSummary, import_signals
from slapshot.recordings.importing.signal_mapping import is_signal_mapping
from slapshot.recordings.importing.track_importer import ImportSummary, import_tracks
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.read import format_version, read_recording
from slapshot.recordings.signal_quality import signal_warnings
from slapshot.recordings.signal_statistics import all_channel_statistics
from slapshot.recordings.signals import SIGNAL_FORMAT_VERSION, read_signals
from slapshot.recordings.summary import describe_hits, describe_signals
from slapshot.text import printable


def run_import(args: argparse.Namespace) -> int:
    """Import CSV files and print a summary.

    Args:
        args: mapping (YAML file), source (folder, file, or path with *), out (folder to make).

    Raises:
        InputError: one line for the user.
    """
    if is_signal_mapping(args.mapping):
        print(format_signal_summary(import_signals(args.mapping, args.source, args.out)))
    else:
        print(format_import_summary(import_tracks(args.mapping, args.source, args.out)))
    return 0


def run_check(args: argparse.Namespace) -> int:
    """Check a recording, describe it, and print quality warnings.

    Args:
        args: recording (folder).

    Raises:
        InputError: one line for the user.
    """
    folder = Path(args.recording)
    if format_version(folder) == SIGNAL_FORMAT_VERSION:
        signals = read_signals(folder)
        channels = all_channel_statistics(signals)
        print(describe_signals(signals, channels))
        print(format_warnings(signal_warnings(signals, channels)))
    else:
        recording = read_recording(folder)
        print(describe_hits(recording))
        print(format_warnings(quality_warnings(recording)))
    return 0


def format_import_summary(summary: ImportSummary) -> str:
    """What an import did, one fact a line."""
    lines = [f"{summary.out}: {summary.hits} hits, {summary.frames} frames"]
    if summary.dropped:
        lines[0] += f"; {len(summary.dropped)} dropped"
    return "\n".join(printable(line) for line in [*lines, *(f"  {line}" for line in summary.lines)])


def format_signal_summary(summary: SignalSummary) -> str:
    """What an import of signals did, one fact a line."""
    episodes = f"{summary.episodes} episode{'s' * (summary.episodes > 1)}"
    lines = [
        f"{summary.out}: {episodes}, {summary.samples} samples",
        *(f"  {line}" for line in summary.lines),
    ]
    return "\n".join(printable(line) for line in lines)


def format_warnings(findings: list[QualityWarning]) -> str:
    """Quality warnings, one on each line."""
    if not findings:
        return "warnings       none"
    return "\n".join(
        [
            f"warnings       {len(findings)}",
            *(printable(f"  {finding}") for finding in findings),
        ]
    )
