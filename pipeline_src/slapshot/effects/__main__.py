"""Print a catalogue of effects as a table: `python -m slapshot.effects`, or with `joints` after it."""

import sys

from slapshot.effects.table import as_markdown, joints_as_markdown

if __name__ == "__main__":
    print(joints_as_markdown() if sys.argv[1:] == ["joints"] else as_markdown(), end="")
