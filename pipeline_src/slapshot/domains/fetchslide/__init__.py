"""FetchSlide: a Fetch robot's gripper pushes a puck away over a table (paper, section IV-B).

MJCF and meshes are those of the gymnasium-robotics package; the robot is commanded as there, by the velocity
of its gripper, so this folder has its own parts: safety, execution and collector.

What needs MuJoCo is imported when it is called: a check of `SceneSettings` alone must not need it.
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
