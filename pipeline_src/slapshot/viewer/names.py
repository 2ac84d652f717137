"""Names that the viewer's modules share: files of a version, timelines of a recording."""

import json
from pathlib import Path
from typing import Any

APPLICATION = "slapshot"
TIME, STEP = "sim_time", "hit"  # timelines: seconds from the hit's start; hits that the belief has seen

HITS_FOLDER = "hits"
SCENE_FILE = "scene.rrd"
LAYOUT_FILE = "layout.rbl"  # of a hit that is opened from the gallery
CARDS_FILE = "cards.rbl"  # of the gallery
INDEX_FILE = "index.json"
INDEX_TABLE = "index.parquet"


def read_index(folder: Path) -> dict[str, Any]:
    """What index.json says: application, domain, and one entry of `hits` a recording."""
    return json.loads((folder / INDEX_FILE).read_text())
