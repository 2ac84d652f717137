"""Blueprints of the viewer: views of a hit and their cameras."""

from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene
from slapshot.viewer.bodies import TIME, extent

_BACKGROUND = (214, 220, 228)
_SPEED = 0.5  # a hit is over in a second and a half


@dataclass(frozen=True)
class ViewTarget:
    """Target of the views.

    Attributes:
        centre: (3,) m, of the board.
        size: m, its longer edge.
    """

    centre: Array
    size: float

    @classmethod
    def of(cls, scene: Scene) -> "ViewTarget":
        """The view target of a scene."""
        low, high = extent(scene)
        return cls(centre=np.append((low + high)[:2] / 2, 0.0), size=float((high - low)[:2].max()))


def hit_layout(view_target: ViewTarget) -> rrb.Blueprint:
    """The scene in 3D, beside it the board from above and what this hit is."""
    return rrb.Blueprint(
        rrb.Horizontal(
            scene_view(view_target),
            rrb.Vertical(
                board_view(view_target),
                rrb.TextDocumentView(origin="about", name="What this is"),
                row_shares=[5, 6],
            ),
            column_shares=[5, 3],
        ),
        rrb.TimePanel(
            timeline=TIME, state="collapsed", playback_speed=_SPEED, play_state="playing", loop_mode="all"
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def scene_view(view_target: ViewTarget, distance: float = 1.0) -> rrb.Spatial3DView:
    """From the side, a little above; `distance` below 1 is nearer."""
    eye, target = np.array([-0.02, -0.7, 0.58]), np.array([-0.02, -0.04, 0.0])
    return _view("Scene", view_target, target + distance * (eye - target), target, (0.0, 0.0, 1.0))


def board_view(view_target: ViewTarget) -> rrb.Spatial3DView:
    """From above, as the ceiling camera sees it: x to the right, y up."""
    return _view(
        "Board from above",
        view_target,
        np.array([-0.03, 0.0, 0.8]),
        np.array([-0.03, 0.0, 0.0]),
        (0.0, 1.0, 0.0),
    )


def _view(
    name: str, view_target: ViewTarget, eye: Array, target: Array, up: tuple[float, float, float]
) -> rrb.Spatial3DView:
    """Of everything, from `eye` to `target`: (3,), relative to the target's centre, in units of its size."""
    return rrb.Spatial3DView(
        origin="/",
        name=name,
        background=rrb.Background(color=_BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=view_target.centre + view_target.size * eye,
            look_target=view_target.centre + view_target.size * target,
            eye_up=up,
        ),
    )
