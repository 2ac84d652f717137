"""FetchSlide: a Fetch robot's gripper pushes a puck over a table (paper, section IV-B).

MJCF and meshes are those of the gymnasium-robotics package. As there, the robot is commanded by the velocity
of its gripper, so that this folder has its own parts: safety, execution and collector.

Modules that need MuJoCo are imported on first use, so that `SceneSettings` can be checked without MuJoCo.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slapshot.config.scene import SceneSettings
from slapshot.config.trajectories import ScriptedHits

if TYPE_CHECKING:
    from slapshot.scenes.scene import Scene

__all__ = ["SceneSettings", "build_scene", "demonstrate", "draw_task"]


def build_scene(settings: SceneSettings) -> "Scene":
    """See model.build_scene."""
    from slapshot.domains.fetchslide import model

    return model.build_scene(settings)


def draw_task(settings: ScriptedHits, rng: np.random.Generator) -> dict[str, float]:
    """See demonstrations.draw_task."""
    from slapshot.domains.fetchslide import demonstrations

    return demonstrations.draw_task(settings, rng)


def demonstrate(
    scene: "Scene", settings: ScriptedHits, tasks: list[dict[str, float]]
) -> list[NDArray[np.float64] | None]:
    """See demonstrations.demonstrate."""
    from slapshot.domains.fetchslide import demonstrations

    return demonstrations.demonstrate(scene, settings, tasks)
