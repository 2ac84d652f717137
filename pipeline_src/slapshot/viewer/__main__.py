"""Stage `viewer`: one Rerun recording a hit, the scene they share, and an index of them."""

import json
import logging
from pathlib import Path
from typing import Any

import pandas as pd
import rerun as rr

from slapshot.command import Run, stage_command
from slapshot.errors import InputError
from slapshot.progress import progress
from slapshot.scenes.scene import Scene
from slapshot.viewer.bodies import Arm, log_shapes
from slapshot.viewer.draw import log_hit
from slapshot.viewer.files import (
    APPLICATION,
    CARDS_FILE,
    HITS_FOLDER,
    INDEX_FILE,
    INDEX_TABLE,
    LAYOUT_FILE,
    SCENE_FILE,
)
from slapshot.viewer.gallery import save_cards
from slapshot.viewer.hits import Hit, gather
from slapshot.viewer.layout import Stage, hit_layout

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write hits/<id>.rrd, scene.rrd, index.json and index.parquet, layout.rbl and cards.rbl.

    Raises:
        InputError: there is no hit to show.
    """
    scene = Scene.load(run.inputs["scene"])
    stage = Stage.of(scene)
    hit_layout(stage).save(APPLICATION, str(run.out / LAYOUT_FILE))
    save_cards(run.out / CARDS_FILE, APPLICATION, stage)
    with _recording(run.out / SCENE_FILE, "scene") as shared:
        log_shapes(shared, scene)
    (run.out / HITS_FOLDER).mkdir()
    arm = Arm(scene)
    counts = {source: run.config[source] for source in ("simulated", "recorded")}
    rows = []
    for hit in progress(gather(run.inputs, scene.info, counts), sum(counts.values()), "hits"):
        row = _row(hit)
        with _recording(run.out / row["file"], hit.id) as recording:
            recording.send_recording_name(hit.title)
            recording.send_property("hit", rr.AnyValues(**_properties(hit)))
            log_hit(recording, hit, arm, scene.info)
        rows.append(row)
    if not rows:
        raise InputError("viewer: no hit has a prediction; evaluate some, or show more than none")
    index = {"application": APPLICATION, "domain": run.config["domain"], "hits": rows}
    (run.out / INDEX_FILE).write_text(json.dumps(index, indent=1) + "\n")
    pd.DataFrame(rows).to_parquet(run.out / INDEX_TABLE, index=False)
    log.info("%d hits", len(rows))


def _recording(path: Path, name: str) -> rr.RecordingStream:
    """A recording that is written to `path`, complete when its block ends."""
    recording = rr.RecordingStream(APPLICATION, recording_id=name)
    recording.save(path)
    return recording


def _row(hit: Hit) -> dict[str, Any]:
    """What the index says of a hit."""
    return {
        "file": f"{HITS_FOLDER}/{hit.id}.rrd",
        "recording_id": hit.id,
        "title": hit.title,
        **hit.facts,
        "samples": int(hit.beliefs["samples"].iloc[-1]),
        "error_before_m": float(hit.errors[0]),
        "error_after_m": float(hit.errors[-1]),
    }


def _properties(hit: Hit) -> dict[str, Any]:
    """What a card of the gallery says of a hit."""
    return {
        "source": hit.facts["source"],
        "group": hit.facts["group"],
        "note": hit.note,
        "hits_seen": int(hit.beliefs["samples"].iloc[-1]),
        "error_before_cm": round(100 * float(hit.errors[0]), 1),
        "error_after_cm": round(100 * float(hit.errors[-1]), 1),
    }


if __name__ == "__main__":
    stage_command("viewer", produce)
