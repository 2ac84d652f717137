"""A version's files: one recording a hit, and the scene that all hits share."""

from pathlib import Path
from typing import Any

import rerun as rr

from slapshot.scenes.scene import Scene, SceneInfo
from slapshot.viewer.bodies import Arm, log_shapes
from slapshot.viewer.draw import log_hit
from slapshot.viewer.hits import Hit
from slapshot.viewer.names import APPLICATION, HITS_FOLDER, SCENE_FILE


def write_scene(folder: Path, scene: Scene) -> None:
    """Write the shapes of a scene, static and without the object."""
    with _recording(folder / SCENE_FILE, "scene") as recording:
        log_shapes(recording, scene)


def write_hit(folder: Path, hit: Hit, arm: Arm, info: SceneInfo) -> dict[str, Any]:
    """Write a hit's recording; return what the index says of it."""
    seen = int(hit.beliefs["samples"].iloc[-1])
    before, after = float(hit.errors[0]), float(hit.errors[-1])
    file = f"{HITS_FOLDER}/{hit.id}.rrd"
    with _recording(folder / file, hit.id) as recording:
        recording.send_recording_name(hit.title)
        recording.send_property(
            "hit",
            rr.AnyValues(
                note=hit.note,
                group=hit.facts["group"],
                hits_seen=seen,
                error_before_cm=round(100 * before, 1),
                error_after_cm=round(100 * after, 1),
            ),
        )
        log_hit(recording, hit, arm, info)
    return {
        "file": file,
        "recording_id": hit.id,
        "title": hit.title,
        **hit.facts,
        "samples": seen,
        "error_before_m": before,
        "error_after_m": after,
    }


def _recording(path: Path, name: str) -> rr.RecordingStream:
    """A recording that is written to `path`, complete when its block ends.

    It carries no layout, which would double its size: layout.rbl is shared too.
    """
    recording = rr.RecordingStream(APPLICATION, recording_id=name)
    recording.save(path)
    return recording
