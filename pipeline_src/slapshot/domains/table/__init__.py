"""Table: a box slides on a table; nothing in the scene strikes it. For recordings with tracks only.

Modules that need MuJoCo are imported on first use, so that `SceneSettings` can be checked without MuJoCo.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slapshot.config.trajectories import ScriptedHits
from slapshot.domains.table.settings import TableScene as SceneSettings

if TYPE_CHECKING:
    from slapshot.scenes.scene import Scene

__all__ = ["SceneSettings", "build_scene", "demonstrate", "draw_task"]


def build_scene(settings: SceneSettings) -> "Scene":
    """See model.build_scene."""
    from slapshot.domains.table import model

    return model.build_scene(settings)


def draw_task(settings: ScriptedHits, rng: np.random.Generator) -> dict[str, float]:
    """See demonstrations.draw_task."""
    from slapshot.domains.table import demonstrations

    return demonstrations.draw_task(settings, rng)


def demonstrate(
    scene: "Scene", settings: ScriptedHits, tasks: list[dict[str, float]]
) -> list[NDArray[np.float64] | None]:
    """See demonstrations.demonstrate."""
    from slapshot.domains.table import demonstrations

    return demonstrations.demonstrate(scene, settings, tasks)
