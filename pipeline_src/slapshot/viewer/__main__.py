"""Stage `viewer`: one Rerun recording a hit, the scene they share, and an index of them."""

import json
import logging

import pandas as pd

from slapshot.command import Run, stage_command
from slapshot.config.results import ViewerSettings
from slapshot.errors import InputError
from slapshot.parquet import read_frame, write_table
from slapshot.progress import progress
from slapshot.recordings.read import recording_folders
from slapshot.scenes.scene import Scene
from slapshot.viewer.bodies import APPLICATION, Arm
from slapshot.viewer.gallery import save_cards
from slapshot.viewer.hit_recording import (
    CARDS_FILE,
    HITS_FOLDER,
    INDEX_FILE,
    INDEX_TABLE,
    LAYOUT_FILE,
    write_hit,
    write_scene,
)
from slapshot.viewer.hits import read_hits, select_hits
from slapshot.viewer.layout import ViewTarget, hit_layout, scene_view

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write hits/<id>.rrd, scene.rrd, index.json, index.parquet, layout.rbl (a hit's) and cards.rbl.

    Raises:
        InputError: there is no hit to show.
    """
    settings = run.settings(ViewerSettings)
    counts = {"simulated": settings.simulated, "recorded": settings.recorded}
    predictions = read_frame(run.inputs["predictions"] / "predictions.parquet")
    selected = select_hits(predictions, counts)
    if selected.empty:
        raise InputError("viewer: no hit to show; let `simulated` and `recorded` not both be 0")
    scene = Scene.load(run.inputs["scene"])
    view_target, arm = ViewTarget.of(scene), Arm(scene)
    (run.out / HITS_FOLDER).mkdir()
    recordings = recording_folders(settings.recordings, run.inputs)
    hits = read_hits(run.inputs, recordings, scene.info, selected, predictions, settings.domain)
    rows = [
        write_hit(run.out, hit, arm, scene.info)
        for hit in progress(hits, len(selected), "recordings of hits")
    ]
    write_scene(run.out, scene)
    hit_layout(view_target).save(APPLICATION, run.out / LAYOUT_FILE)
    save_cards(run.out / CARDS_FILE, APPLICATION, scene_view(view_target, distance=0.8))
    index = {"application": APPLICATION, "domain": settings.domain, "hits": rows}
    (run.out / INDEX_FILE).write_text(json.dumps(index, indent=1) + "\n")
    write_table(pd.DataFrame(rows), run.out / INDEX_TABLE)
    log.info("%d hits", len(rows))


if __name__ == "__main__":
    stage_command("viewer", produce)
