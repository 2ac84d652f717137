"""diagnosis.rrd: recorded, nominal and augmented tracks over each other on the board, with the verdict.

On the timeline of hits, one hit after another is seen whole; on that of time, all of them slide at once.
"""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.colors import to_rgb

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.report import style
from slapshot.diagnosis.pucks.report.location_map import arrow_scale
from slapshot.diagnosis.pucks.report.outcome import Outcome
from slapshot.diagnosis.pucks.report.predictions import Predicted
from slapshot.viewer.bodies import APPLICATION, TIME

RECORDING_FILE = "diagnosis.rrd"
HIT = "hit"
CAPTION = (
    "Orange: recorded (a dot a camera frame). Grey: nominal scene with friction refitted. Blue: scene with "
    "what was found. Purple arrows: pushes that the nominal scene lacks and that are unlikely to be chance; "
    "pale grey ones may be. Launches are told from the first frames of each hit. "
    f"Timeline `{HIT}` shows one hit after another, timeline `{TIME}` lets all of them slide at once."
)

RATE = 25.0  # places a second on the timeline of time
_HEIGHTS = {"nominal": 0.001, "augmented": 0.002, "recorded": 0.003}  # m above the board
_COLOURS = {"nominal": style.NOMINAL, "augmented": style.AUGMENTED, "recorded": style.RECORDED}
_BOARD, _BACKGROUND, _FAINT = (240, 240, 246), (214, 220, 228), (200, 200, 205)
_MARGIN = 0.1  # m of board around the tracks
_THICK, _THIN, _DOT = (rr.Radius.ui_points(r) for r in (1.4, 0.6, 1.8))


def write_recording(outcome: Outcome, text: str, folder: Path) -> None:
    """Write diagnosis.rrd.

    Args:
        outcome: what was found.
        text: the verdict in Markdown.
        folder: that exists.
    """
    parts = [outcome.predicted_used, outcome.predicted]
    origins, vectors = _arrows(outcome)
    places = np.concatenate([*(p.recorded[p.valid] for p in parts), origins + vectors])
    low, high = places.min(0) - _MARGIN, places.max(0) + _MARGIN
    with rr.RecordingStream(APPLICATION, recording_id="diagnosis") as recording:
        recording.save(folder / RECORDING_FILE, default_blueprint=_layout(low, high))
        recording.send_recording_name("Diagnosis")
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for name, told in (("verdict", text), ("about", CAPTION)):
            recording.log(name, rr.TextDocument(told, media_type="text/markdown"), static=True)
        _log_board(recording, low, high, parts)
        _log_arrows(recording, outcome)
        for predicted, held_out in zip(parts, (False, True), strict=True):
            _log_hits(recording, predicted, held_out)
        _log_slides(recording, parts)


def _log_board(recording: rr.RecordingStream, low: Array, high: Array, parts: list[Predicted]) -> None:
    """The board, and on it all recorded tracks, faintly."""
    half = np.append((high - low) / 2, 0.005)
    board = rr.Boxes3D(
        half_sizes=[half],
        centers=[np.append((low + high) / 2, -0.006)],
        colors=[_BOARD],
        fill_mode=rr.components.FillMode.Solid,
    )
    recording.log("board", board, static=True)
    strips = [
        _on_board(p.recorded[i][p.valid[i]], 0.0)
        for p in parts
        for i in range(len(p.hit))
        if p.valid[i].any()
    ]
    recording.log("board/all_hits", rr.LineStrips3D(strips, colors=[_FAINT], radii=_THIN), static=True)


def _log_arrows(recording: rr.RecordingStream, outcome: Outcome) -> None:
    """Pushes that the nominal scene lacks, as in the location map."""
    origins, vectors = _arrows(outcome)
    significant = outcome.arrows["significant"]
    recording.log(
        "residual_push",
        rr.Arrows3D(
            origins=_on_board(origins, 0.004),
            vectors=np.column_stack([vectors, np.zeros(len(vectors))]),
            colors=[_rgb(style.PUSH if sure else style.NOTHING) for sure in significant],
            radii=[0.004 if sure else 0.002 for sure in significant],
        ),
        static=True,
    )


def _arrows(outcome: Outcome) -> tuple[Array, Array]:
    """(n, 2) m where arrows begin, and (n, 2) m from there to their tips."""
    arrows = outcome.arrows
    origins, pushes = arrows[["x_m", "y_m"]], arrows[["ax_m_s2", "ay_m_s2"]]
    return origins.to_numpy(float), arrow_scale(arrows) * pushes.to_numpy(float)


def _scenes(predicted: Predicted) -> dict[str, Array]:
    """Name -> places (n, frames, 2)."""
    found = {"recorded": predicted.recorded, "nominal": predicted.nominal}
    return found if predicted.augmented is None else found | {"augmented": predicted.augmented}


def _log_hits(recording: rr.RecordingStream, predicted: Predicted, held_out: bool) -> None:
    """Tracks, errors and a line of text of each hit, on the timeline of hits."""
    index = [rr.TimeColumn(HIT, sequence=predicted.hit)]
    counts = predicted.valid.sum(1)
    errors: dict[str, Array] = {}
    for scene, places in _scenes(predicted).items():
        strips = [_on_board(p[:k], _HEIGHTS[scene]) for p, k in zip(places, counts, strict=True)]
        colours = np.tile(np.array(_rgb(_COLOURS[scene]), np.uint8), (len(strips), 1))
        if scene == "recorded":
            dots = [
                *rr.Points3D.columns(positions=np.concatenate(strips)).partition(counts),
                *rr.Points3D.columns(colors=colours, radii=np.full(len(strips), _DOT)),
            ]
            recording.send_columns(f"one_hit/{scene}", index, dots)
            continue
        errors[scene] = predicted.rmse(places)
        lines = rr.LineStrips3D.columns(strips=strips, colors=colours, radii=np.full(len(strips), _THICK))
        recording.send_columns(f"one_hit/{scene}", index, lines)
        series = f"track_error_mm/{scene}"
        colour = _rgb(_COLOURS[scene])
        recording.log(series, rr.SeriesLines(colors=[colour], names=[scene], widths=[2.0]), static=True)
        recording.send_columns(series, index, rr.Scalars.columns(scalars=1e3 * errors[scene]))
    kind = "held out" if held_out else "used for fitting"
    texts = [
        f"**Hit {hit}** ({kind}): track error "
        + ", ".join(f"{name} {1e3 * e[i]:.1f} mm" for name, e in errors.items())
        for i, hit in enumerate(predicted.hit)
    ]
    media = ["text/markdown"] * len(texts)
    recording.send_columns("this_hit", index, rr.TextDocument.columns(text=texts, media_type=media))


def _log_slides(recording: rr.RecordingStream, parts: list[Predicted]) -> None:
    """Where the objects of all hits are, on the timeline of time."""
    longest = max(float(p.times[p.valid].max()) for p in parts)
    moments = np.arange(0.0, longest + 1 / RATE, 1 / RATE)
    index = [rr.TimeColumn(TIME, duration=moments)]
    for scene in _scenes(parts[0]):
        paths = [
            np.stack(
                [np.interp(moments, p.times[i][p.valid[i]], q[i][p.valid[i]][:, axis]) for axis in (0, 1)]
            )
            for p in parts
            for q in (_scenes(p)[scene],)
            for i in range(len(p.hit))
        ]
        places = np.stack(paths).transpose(2, 0, 1)
        flat = _on_board(places.reshape(-1, 2), _HEIGHTS[scene])
        colours = np.tile(np.array(_rgb(_COLOURS[scene]), np.uint8), (len(moments), 1))
        columns = [
            *rr.Points3D.columns(positions=flat).partition([len(paths)] * len(moments)),
            *rr.Points3D.columns(colors=colours, radii=np.full(len(moments), _DOT)),
        ]
        recording.send_columns(f"all_hits/{scene}", index, columns)


def _layout(low: Array, high: Array) -> rrb.Blueprint:
    """The board from above and a little aside; beside it the verdict, the hit and the errors."""
    size = float((high - low).max())
    centre = np.append((low + high) / 2, 0.0)
    board = rrb.Spatial3DView(
        origin="/",
        name="Board",
        background=rrb.Background(color=_BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=centre + size * np.array([0.0, -0.12, 1.06]), look_target=centre, eye_up=(0.0, 1.0, 0.0)
        ),
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                board,
                rrb.TimeSeriesView(origin="track_error_mm", name="Track error by hit (mm)"),
                row_shares=[4, 1],
            ),
            rrb.Vertical(
                rrb.TextDocumentView(origin="verdict", name="Verdict"),
                rrb.TextDocumentView(origin="this_hit", name="This hit"),
                rrb.TextDocumentView(origin="about", name="What is seen"),
                row_shares=[7, 1, 2],
            ),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=HIT, state="collapsed", fps=1.0, play_state="paused", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _on_board(places: Array, height: float) -> Array:
    """(n, 3) m of places (n, 2) at a height."""
    return np.column_stack([places, np.full(len(places), height)])


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue
