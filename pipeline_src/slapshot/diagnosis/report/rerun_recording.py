"""recording.rrd: the rig as recorded and as models predict it, over each other, with readings and errors.

Held-out windows follow each other on one timeline.
"""

from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.colors import to_rgb

from slapshot.arrays import Array
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.report.motion import Motion, predicted_half, predicted_motion, recorded_motion
from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.report.presentation import MODEL_COLOURS, MODELS, RECORDED, plain, scaled
from slapshot.viewer.bodies import APPLICATION, SOLID, TIME, rotation_quaternion, shape_of

RECORDING_FILE = "recording.rrd"
CAPTION = (
    "In its own colours: the rig as recorded; what was not observed stands where the best model has it. "
    "Grey: the nominal model. Blue: the model with what was found, if anything was. Timeline "
    f"`{TIME}` shows held-out windows one after another, each predicted from the data before it and "
    "the recorded controls. A rig without shapes is drawn "
    "as boxes of the same mass and inertia."
)

_MOST_WINDOWS, _MOST_CHANNELS = 16, 12
_RATE = 60.0  # poses a second
_GAP_S = 0.3
_OPACITY = 0.45
_VISIBLE_GROUP = 2  # MuJoCo's own viewer hides higher ones: shapes for collisions
_BACKGROUND = (214, 220, 228)


def write_recording(outcome: Outcome, text: str, folder: Path) -> None:
    """Write recording.rrd.

    Args:
        outcome: what was found.
        text: the verdict in Markdown.
        folder: that exists.
    """
    count = outcome.windows.shape[0]
    some = np.unique(np.linspace(0, count - 1, min(count, _MOST_WINDOWS)).astype(int))
    windows = predicted_half(outcome.windows.select(some))
    by_model = list(dict.fromkeys(["nominal", outcome.best]))
    motions = {model_name: predicted_motion(outcome, model_name, some) for model_name in by_model}
    motions = {"recorded": recorded_motion(motions[outcome.best], windows.y), **motions}
    moments = _moments(windows)
    with rr.RecordingStream(APPLICATION, recording_id="diagnosis") as recording:
        channels = _channels(outcome, windows)
        units = {c: _unit(outcome, motions, c) for c in channels}
        recording.save(
            folder / RECORDING_FILE, default_blueprint=_layout(outcome, motions["recorded"], units)
        )
        recording.send_recording_name("Diagnosis")
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for name, content in (("verdict", text), ("about", CAPTION)):
            recording.log(name, rr.TextDocument(content, media_type="text/markdown"), static=True)
        for name, motion in motions.items():
            _log_shapes(recording, name, motion)
            _log_poses(recording, name, motion, moments)
        _log_series(recording, outcome, motions, moments, units)
        _log_places(recording, windows, moments)


def _moments(windows: Segments) -> Array:
    """(W, n) s on the timeline: windows one after another."""
    nodes = windows.shape[1]
    length = nodes * windows.interval + _GAP_S
    return np.arange(windows.shape[0])[:, None] * length + np.arange(nodes) * windows.interval


def _moving(model: mujoco.MjModel) -> list[int]:
    """Bodies that some joint moves; those that are welded to one move with it."""
    return [int(body) for body in np.unique(model.body_weldid) if body != 0]


def _drawn(model: mujoco.MjModel, geom: int) -> bool:
    plane = model.geom_type[geom] in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    return bool(model.geom_group[geom] <= _VISIBLE_GROUP and model.geom_rgba[geom, 3] > 0 and not plane)


def _colour(name: str) -> Array | None:
    """Of all shapes of a motion; None for their own colours."""
    return None if name == "recorded" else np.array([*to_rgb(MODEL_COLOURS[name]), _OPACITY])


def _log_shapes(recording: rr.RecordingStream, name: str, motion: Motion) -> None:
    """Shapes in the frames of their bodies, once; what does not move only as recorded."""
    model, colour = motion.rig.model, _colour(name)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bare = not any(_drawn(model, g) and model.body_weldid[model.geom_bodyid[g]] for g in range(model.ngeom))
    for geom in range(model.ngeom):
        body = int(model.body_weldid[model.geom_bodyid[geom]])
        if not _drawn(model, geom) or (body == 0 and name != "recorded"):
            continue
        turn = data.xmat[body].reshape(3, 3)
        place = turn.T @ (data.geom_xpos[geom] - data.xpos[body])
        shape = shape_of(model, geom, place, turn.T @ data.geom_xmat[geom].reshape(3, 3), colour)
        if shape is not None:
            path = ["rig", name, model.body(body).name, model.geom(geom).name or f"geom{geom}"]
            recording.log(path, shape, static=True)
    for body in _moving(model) if bare else []:
        path = ["rig", name, model.body(body).name, "inertia"]
        recording.log(path, _inertia_box(model, body, colour), static=True)


def _inertia_box(model: mujoco.MjModel, body: int, colour: Array | None) -> rr.Boxes3D:
    """A box of the body's mass and inertia."""
    moments, mass = model.body_inertia[body], max(float(model.body_mass[body]), 1e-12)
    half = 0.5 * np.sqrt(np.maximum(6 * (moments.sum() - 2 * moments) / mass, 1e-6))
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    return rr.Boxes3D(
        half_sizes=[half],
        centers=[model.body_ipos[body]],
        quaternions=[rotation_quaternion(turn.reshape(3, 3))],
        colors=[np.array([*to_rgb(RECORDED), 1.0]) if colour is None else colour],
        fill_mode=SOLID,
    )


def _log_poses(recording: rr.RecordingStream, name: str, motion: Motion, moments: Array) -> None:
    """Where bodies are, at so many moments as can be seen."""
    model = motion.rig.model
    data, bodies = mujoco.MjData(model), _moving(model)
    every = max(1, round(1 / (_RATE * max(moments[0, 1] - moments[0, 0], 1e-6))))
    qpos = motion.qpos[:, ::every].reshape(-1, model.nq)
    times = moments[:, ::every].reshape(-1)
    places, turns = np.empty((len(qpos), len(bodies), 3)), np.empty((len(qpos), len(bodies), 4))
    for k, position in enumerate(qpos):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        places[k], turns[k] = data.xpos[bodies], data.xquat[bodies]
    for i, body in enumerate(bodies):
        recording.send_columns(
            rr.new_entity_path(["rig", name, model.body(body).name]),
            [rr.TimeColumn(TIME, duration=times)],
            rr.Transform3D.columns(translation=places[:, i], quaternion=np.roll(turns[:, i], -1, axis=1)),
        )


def _channels(outcome: Outcome, windows: Segments) -> list[int]:
    """Channels of which readings and errors are shown: positions first."""
    seen = [c for c in range(windows.y.shape[2]) if np.isfinite(windows.y[..., c]).any()]
    quantity = [o.quantity for o in outcome.rig.observations]
    return sorted(seen, key=lambda c: (quantity[c] != "position", c))[:_MOST_CHANNELS]


def _unit(outcome: Outcome, motions: dict[str, Motion], channel: int) -> tuple[str, float]:
    """Readable unit of a channel's errors, and its factor."""
    recorded = motions["recorded"].seen[..., channel]
    size = max(
        float(np.nanmax(np.abs(recorded - motion.seen[..., channel])))
        for motion in list(motions.values())[1:]
    )
    return scaled(plain(outcome.units[channel]), size)


def _log_series(
    recording: rr.RecordingStream,
    outcome: Outcome,
    motions: dict[str, Motion],
    moments: Array,
    units: dict[int, tuple[str, float]],
) -> None:
    """Readings, and errors of models, channel by channel; nothing between windows."""
    width = np.diff(moments[0, :2])[0]
    times = np.concatenate([moments, moments[:, -1:] + width], axis=1).reshape(-1)
    index = [rr.TimeColumn(TIME, duration=times)]
    recorded = motions["recorded"].seen

    def log(path: list[object], name: str, values: Array) -> None:
        gapped = np.pad(values, ((0, 0), (0, 1)), constant_values=np.nan).reshape(-1)
        colour = [round(255 * part) for part in to_rgb(MODEL_COLOURS.get(name, RECORDED))]
        label = MODELS.get(name, name)
        recording.log(path, rr.SeriesLines(colors=[colour], names=[label], widths=[2.0]), static=True)
        recording.send_columns(rr.new_entity_path(path), index, rr.Scalars.columns(scalars=gapped))

    for channel, (_, factor) in units.items():
        part = outcome.rig.observations[channel].channel
        for name, motion in motions.items():
            log(["readings", part, name], name, motion.seen[..., channel])
            if name != "recorded":
                error = factor * (recorded[..., channel] - motion.seen[..., channel])
                log(["errors", part, name], name, error)


def _log_places(recording: rr.RecordingStream, windows: Segments, moments: Array) -> None:
    """Which window is seen."""
    for k in range(windows.shape[0]):
        episode = int(windows.ids[windows.episode[k]])
        recording.set_time(TIME, duration=float(moments[k, 0]))
        said = f"Episode {episode}, {windows.time[k, 0]:.2f} to {windows.time[k, -1]:.2f} s"
        recording.log("this_window", rr.TextDocument(said))
    recording.reset_time()


def _layout(outcome: Outcome, motion: Motion, units: dict[int, tuple[str, float]]) -> rrb.Blueprint:
    """The rig, beside it the verdict and what is seen, below readings and errors."""
    low, high = _extent(motion)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low))
    rig = rrb.Spatial3DView(
        origin="rig",
        name="Rig",
        background=rrb.Background(color=_BACKGROUND),
        eye_controls=rrb.EyeControls3D(
            position=centre + size * np.array([0.55, -1.25, 0.45]),
            look_target=centre,
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    tabs = []
    for channel, (unit, _) in units.items():
        part = outcome.rig.observations[channel].channel
        tabs.append(
            rrb.Vertical(
                rrb.TimeSeriesView(
                    origin=rr.new_entity_path(["readings", part]), name=f"{part} ({outcome.units[channel]})"
                ),
                rrb.TimeSeriesView(
                    origin=rr.new_entity_path(["errors", part]),
                    name="recorded less model" + (f" ({unit})" if unit else ""),
                ),
                name=part,
            )
        )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(rig, rrb.Tabs(*tabs), row_shares=[3, 2]),
            rrb.Vertical(
                rrb.TextDocumentView(origin="verdict", name="Verdict"),
                rrb.TextDocumentView(origin="this_window", name="This window"),
                rrb.TextDocumentView(origin="about", name="What is seen"),
                row_shares=[7, 1, 2],
            ),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIME, state="collapsed", play_state="paused", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _extent(motion: Motion) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) in m of where bodies are, with room for their shapes."""
    model = motion.rig.model
    data, places = mujoco.MjData(model), []
    qpos = motion.qpos.reshape(-1, model.nq)
    for position in qpos[:: max(1, len(qpos) // 50)]:
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        places += [data.xpos[1:].copy(), data.xipos[1:].copy()]
    found = np.concatenate(places)
    room = 0.1 + 0.1 * np.ptp(found, axis=0).max()
    return found.min(0) - room, found.max(0) + room
