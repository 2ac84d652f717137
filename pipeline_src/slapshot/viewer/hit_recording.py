"""A version's files: one Rerun recording for each hit, entity by entity, and the scene they share."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rerun as rr

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene, SceneInfo
from slapshot.viewer.bodies import APPLICATION, ROOT, SOLID, TIME, Arm, log_shapes
from slapshot.viewer.hits import Hit

STEP = "hit"  # timeline: number of hits that the belief has seen

HITS_FOLDER = "hits"
SCENE_FILE = "scene.rrd"
LAYOUT_FILE = "layout.rbl"  # of a hit that is opened from the gallery
CARDS_FILE = "cards.rbl"  # of the gallery
INDEX_FILE = "index.json"
INDEX_TABLE = "index.parquet"

RATE = 30.0  # poses of the arm a second

PRIOR_COLOUR, ADAPTED_COLOUR = (128, 128, 128), (0, 114, 178)  # the colours of the figures
TRUTH_COLOUR, TRACK_COLOUR = (0, 0, 0), (213, 94, 0)
# Objects named by their colour; every other one is drawn like the scene's own.
_OBJECT_COLOURS = {"red": (214, 39, 40), "blue": (31, 79, 180)}
_SCENE_OBJECT_COLOUR = (204, 31, 31)

# Heights in m above the board: more important entities lie above less important ones.
_REGION_HEIGHT, _TRACK_HEIGHT, _TRUTH_HEIGHT = 0.002, 0.004, 0.006
_CORNERS = 64
_CROSS_HALF = 0.035  # m, half a stroke
_PIN_HEIGHT = 0.12  # m, its height
_THICK, _THIN, _DOT = (rr.Radius.ui_points(r) for r in (1.6, 0.9, 4.0))


def read_index(folder: Path) -> dict[str, Any]:
    """What index.json says: application, domain, and one entry of `hits` a recording."""
    return json.loads((folder / INDEX_FILE).read_text())


def log_hit(recording: rr.RecordingStream, hit: Hit, arm: Arm, info: SceneInfo) -> None:
    """Log everything about a hit except the scene's shapes."""
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("about", rr.TextDocument(describe(hit), media_type="text/markdown"), static=True)
    _log_arm(recording, hit, arm)
    _log_object(recording, hit, info)
    _log_track(recording, hit)
    _log_truth(recording, hit.truth)
    _log_prediction(recording, "before", hit, 0, PRIOR_COLOUR)
    _log_prediction(recording, "after", hit, -1, ADAPTED_COLOUR)
    _log_adaptation(recording, hit)


def _log_arm(recording: rr.RecordingStream, hit: Hit, arm: Arm) -> None:
    if not len(hit.joints):
        return
    times = np.arange(hit.joint_times[0], hit.joint_times[-1], 1 / RATE)
    joints = np.stack([np.interp(times, hit.joint_times, q) for q in hit.joints.T], axis=1)
    for name, positions, quaternions in arm.poses(joints):
        recording.send_columns(
            rr.new_entity_path([ROOT, name]),
            _timelines(times),
            rr.Transform3D.columns(translation=positions, quaternion=quaternions),
        )


def _timelines(times: Array) -> list[rr.TimeColumn]:
    """Timelines of moving entities; on the timeline of hits seen, the final state is shown."""
    return [
        rr.TimeColumn(TIME, duration=times),
        rr.TimeColumn(STEP, sequence=np.zeros(len(times), np.int64)),
    ]


def _log_object(recording: rr.RecordingStream, hit: Hit, info: SceneInfo) -> None:
    colour = _OBJECT_COLOURS.get(hit.facts["object"], _SCENE_OBJECT_COLOUR)
    shape = rr.Cylinders3D(
        lengths=[info.object_height], radii=[info.object_radius], colors=[colour], fill_mode=SOLID
    )
    recording.log("object", shape, static=True)
    if not len(hit.track):
        return
    times, positions = hit.track[:, 0], on_board(hit.track[:, 1:3], info.object_height / 2)
    # Where yaw was not measured, the last value is held.
    half = pd.Series(hit.track[:, 3]).ffill().bfill().fillna(0.0).to_numpy() / 2
    nothing = np.zeros_like(half)
    recording.send_columns(
        "object",
        _timelines(times),
        rr.Transform3D.columns(
            translation=positions,
            quaternion=np.stack([nothing, nothing, np.sin(half), np.cos(half)], axis=1),
        ),
    )


def _log_track(recording: rr.RecordingStream, hit: Hit) -> None:
    if not len(hit.track):
        return
    positions = on_board(hit.track[:, 1:3], _TRACK_HEIGHT)
    gaps = np.flatnonzero(np.diff(hit.track[:, 0]) > hit.max_gap_s) + 1
    strips = [part for part in np.split(positions, gaps) if len(part) > 1]
    recording.log("track", rr.LineStrips3D(strips, colors=[TRACK_COLOUR], radii=_THIN), static=True)
    if np.isfinite(hit.max_gap_s):  # camera frames are shown individually
        frames = rr.Points3D(positions, colors=[TRACK_COLOUR], radii=rr.Radius.ui_points(1.8))
        recording.log("track/frames", frames, static=True)


def _log_truth(recording: rr.RecordingStream, truth: Array) -> None:
    """A cross, and a pin that stays visible when the object lies on the cross."""
    stroke = np.array([[-1.0, -1.0], [1.0, 1.0]]) * _CROSS_HALF / np.sqrt(2)
    strips = [on_board(truth + s, _TRUTH_HEIGHT) for s in (stroke, stroke * [1, -1])]
    strips.append(np.append(np.tile(truth, (2, 1)), [[0.0], [_PIN_HEIGHT]], axis=1))
    recording.log("rest", rr.LineStrips3D(strips, colors=[TRUTH_COLOUR], radii=_THICK), static=True)


def _log_prediction(
    recording: rr.RecordingStream, name: str, hit: Hit, row: int, colour: tuple[int, int, int]
) -> None:
    belief = hit.beliefs.iloc[row]
    strips = [on_board(_outline_of(belief, share), _REGION_HEIGHT) for share in (50, 90)]
    regions = rr.LineStrips3D(strips, colors=[colour], radii=np.array([_THICK, _THIN]))
    recording.log(f"{name}/regions", regions, static=True)
    position = on_board(belief[["x_m", "y_m"]].to_numpy(float)[None], _REGION_HEIGHT)
    recording.log(f"{name}/point", rr.Points3D(position, colors=[colour], radii=_DOT), static=True)


def _log_adaptation(recording: rr.RecordingStream, hit: Hit) -> None:
    """Point and 90 % region as they were after each number of hits seen, on the timeline of hits."""
    beliefs = milestones(hit.beliefs)
    index = [rr.TimeColumn(STEP, sequence=beliefs["samples"].to_numpy(np.int64))]
    count = len(beliefs)
    shades = np.linspace(PRIOR_COLOUR, ADAPTED_COLOUR, count).round().astype(np.uint8)
    positions = on_board(beliefs[["x_m", "y_m"]].to_numpy(float), _REGION_HEIGHT)
    points = rr.Points3D.columns(positions=positions, colors=shades, radii=np.full(count, _DOT))
    recording.send_columns("learning/point", index, points)
    strips = [on_board(_outline_of(beliefs.iloc[k], 90), _REGION_HEIGHT) for k in range(count)]
    regions = rr.LineStrips3D.columns(strips=strips, colors=shades, radii=np.full(count, _THIN))
    recording.send_columns("learning/region_90", index, regions)


def milestones(beliefs: pd.DataFrame) -> pd.DataFrame:
    """Rows after 0, 1, 2, 4, 8, ... hits and after the most: what is worth a line."""
    seen = beliefs["samples"].to_numpy(np.int64)
    return beliefs[(seen & (seen - 1) == 0) | (seen == seen[-1])]


def on_board(points: Array, height: float) -> Array:
    """(n, 3) m of points (n, 2) at a height."""
    return np.column_stack([points, np.full(len(points), height)])


def _outline_of(belief: pd.Series, share: int) -> Array:
    """(corners, 2) m of the region that holds the rest point in `share` % of cases."""
    mean = belief[["x_m", "y_m"]].to_numpy(float)
    covariance = belief[["cov_xx", "cov_xy", "cov_xy", "cov_yy"]].to_numpy(float).reshape(2, 2)
    return outline(mean, covariance, belief[f"radius2_{share}"])


def outline(mean: Array, covariance: Array, radius2: float) -> Array:
    """(corners, 2) m, closed: points whose squared Mahalanobis distance from `mean` is `radius2`.

    x = m + r L u with L L' = C and u on the unit circle.
    """
    angle = np.linspace(0, 2 * np.pi, _CORNERS + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return mean + np.sqrt(radius2) * circle @ np.linalg.cholesky(covariance).T


def describe(hit: Hit) -> str:
    """Description of a recording, in Markdown."""
    most = hit.beliefs["samples"].iloc[-1]
    frames = ", a dot for each camera frame" if np.isfinite(hit.max_gap_s) else ""
    return f"""\
# {hit.title}

*{hit.note}*

The predicted rest point was off by **{100 * hit.errors[0]:.1f} cm** before adaptation (grey) and by
**{100 * hit.errors[-1]:.1f} cm** after {most} other hits had been seen (blue).

| hits seen | error |
|---:|---:|
{_error_rows(hit)}

Thick ellipse: 50 % region, thin ellipse: 90 % region, calibrated on validation data.
Black cross and pin: where the object stopped. Orange: its track{frames}.

Timeline `{TIME}` plays the hit; timeline `{STEP}` steps through the number of hits seen.
"""


def _error_rows(hit: Hit) -> str:
    """Lines of a Markdown table."""
    shown = milestones(hit.beliefs)["samples"].tolist()
    errors = dict(zip(hit.beliefs["samples"].tolist(), hit.errors, strict=True))
    return "\n".join(f"| {n} | {100 * errors[n]:.1f} cm |" for n in shown)


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
