"""Check a recording and describe it: python -m slapshot.recordings FOLDER."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from slapshot.errors import InputError
from slapshot.recordings.read import format_version, read_recording
from slapshot.recordings.signal_statistics import all_channel_statistics
from slapshot.recordings.signals import SIGNAL_FORMAT_VERSION, read_signals
from slapshot.recordings.summary import describe_hits, describe_signals


def main(arguments: Sequence[str] | None = None) -> int:
    """Describe the recording that the command line names; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.recordings", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the recording")
    options = parser.parse_args(arguments)
    try:
        if format_version(options.folder) == SIGNAL_FORMAT_VERSION:
            signals = read_signals(options.folder)
            print(describe_signals(signals, all_channel_statistics(signals)))
        else:
            print(describe_hits(read_recording(options.folder)))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
