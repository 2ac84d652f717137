"""What `slapshot import` and `slapshot check` do and print."""

import argparse
from pathlib import Path

from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.importing.importer import ImportSummary, import_tracks
from slapshot.recordings.importing.signal_importer import SignalSummary, import_signals
from slapshot.recordings.importing.signal_mapping import is_signal_mapping
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.read import format_version, read_recording
from slapshot.recordings.signal_measures import measure_all
from slapshot.recordings.signal_quality import odd_signals
from slapshot.recordings.signals import SIGNAL_FORMAT_VERSION, read_signals
from slapshot.recordings.summary import describe_hits, describe_signals
from slapshot.text import printable


def run_import(args: argparse.Namespace) -> int:
    """Import CSV files and say what was made of them.

    Args:
        args: mapping (YAML file), source (folder, file, or path with *), out (folder to make).

    Raises:
        InputError: A line for a person.
    """
    if is_signal_mapping(args.mapping):
        print(say_signals(import_signals(args.mapping, args.source, args.out)))
    else:
        print(say_imported(import_tracks(args.mapping, args.source, args.out)))
    return 0


def run_check(args: argparse.Namespace) -> int:
    """Check a recording, describe it, and say what is odd in it though it is valid.

    Args:
        args: recording (folder).

    Raises:
        InputError: A line for a person.
    """
    folder = Path(args.recording)
    if format_version(folder) == SIGNAL_FORMAT_VERSION:
        signals = read_signals(folder)
        channels = measure_all(signals)
        print(describe_signals(signals, channels))
        print(say_findings(odd_signals(signals, channels)))
    else:
        recording = read_recording(folder)
        print(describe_hits(recording))
        print(say_findings(quality_warnings(recording)))
    return 0


def say_imported(summary: ImportSummary) -> str:
    """What an import did, one fact a line."""
    lines = [f"{summary.out}: {summary.hits} hits, {summary.frames} frames"]
    if summary.dropped:
        lines[0] += f"; {len(summary.dropped)} dropped"
    return "\n".join(printable(line) for line in [*lines, *(f"  {line}" for line in summary.lines)])


def say_signals(summary: SignalSummary) -> str:
    """What an import of signals did, one fact a line."""
    episodes = f"{summary.episodes} episode{'s' * (summary.episodes > 1)}"
    lines = [
        f"{summary.out}: {episodes}, {summary.samples} samples",
        *(f"  {line}" for line in summary.lines),
    ]
    return "\n".join(printable(line) for line in lines)


def say_findings(findings: list[QualityWarning]) -> str:
    """What is odd, one finding a line."""
    if not findings:
        return "odd            nothing was found"
    return "\n".join(
        [
            f"odd            {len(findings)} finding{'s' * (len(findings) > 1)}",
            *(printable(f"  {finding}") for finding in findings),
        ]
    )
