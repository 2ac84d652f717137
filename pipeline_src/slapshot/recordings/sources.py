"""Where the recordings of a recipe lie: in versions of the stage `lab`, or in folders of one's own."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def recording_folders(
    sources: Mapping[str, Mapping[str, Any]], inputs: Mapping[str, Path]
) -> dict[tuple[str, int], Path]:
    """(recording, rig) -> folder; a recording of one's own is rig 0.

    Args:
        sources: recording -> {"rigs": count} or {"path": folder}, as a recipe has them.
        inputs: role -> version folder; a stand-in rig's is lab/<recording>/<rig>.
    """
    folders = {}
    for name, source in sources.items():
        if "path" in source:
            folders[name, 0] = Path(source["path"])
        else:
            folders |= {
                (name, rig): inputs[f"lab/{name}/{rig}"] / "recording" for rig in range(source["rigs"])
            }
    return folders
