"""Where the recordings of a recipe lie: in versions of the stage `lab`, or in folders of one's own."""

from collections.abc import Mapping
from pathlib import Path

from slapshot.config.sources import Source


def recording_folders(
    sources: Mapping[str, Source], inputs: Mapping[str, Path]
) -> dict[tuple[str, int], Path]:
    """(recording, rig) -> folder; a recording of one's own is rig 0.

    Args:
        sources: recording -> where it comes from.
        inputs: role -> version folder; a stand-in rig's is lab/<recording>/<rig>.
    """
    folders = {}
    for name, source in sources.items():
        if source.path is not None:
            folders[name, 0] = Path(source.path)
        else:
            rigs = range(source.rigs or 0)
            folders |= {(name, rig): inputs[f"lab/{name}/{rig}"] / "recording" for rig in rigs}
    return folders
