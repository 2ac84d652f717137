"""Hockey: a KUKA LBR 4+ hits a puck on a whiteboard with a floorball stick (paper, section IV-C).

Modules that need MuJoCo are imported on first use, so that `SceneSettings` can be checked without MuJoCo.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slapshot.config.scene import HockeySettings as SceneSettings
from slapshot.config.trajectories import ScriptedHits

if TYPE_CHECKING:
    from slapshot.scenes.scene import Scene

__all__ = ["SceneSettings", "build_scene", "demonstrate", "draw_task"]


def build_scene(settings: SceneSettings) -> "Scene":
    """See model.build_scene."""
    from slapshot.domains.hockey import model

    return model.build_scene(settings)


def draw_task(settings: ScriptedHits, rng: np.random.Generator) -> dict[str, float]:
    """See demonstrations.draw_task."""
    from slapshot.domains.hockey import demonstrations

    return demonstrations.draw_task(settings, rng)


def demonstrate(
    scene: "Scene", settings: ScriptedHits, tasks: list[dict[str, float]]
) -> list[NDArray[np.float64] | None]:
    """See demonstrations.demonstrate."""
    from slapshot.domains.hockey import demonstrations

    return demonstrations.demonstrate(scene, settings, tasks)
