"""FetchSlide: a Fetch robot's gripper pushes a puck away over a table (paper, section IV-B).

MJCF and meshes are those of the gymnasium-robotics package; the robot is commanded as there, by the velocity
of its gripper, so this folder has its own parts: safety, execution and collector.
"""

from typing import Any

from slapshot.scenes.fetchslide.settings import FetchSlideScene as SceneSettings

__all__ = ["SceneSettings", "build_scene", "demonstrate", "draw_task"]


def __getattr__(name: str) -> Any:
    """The functions, imported when they are asked for: who only checks settings must not need MuJoCo."""
    if name not in __all__:
        raise AttributeError(name)
    from slapshot.scenes.fetchslide.demonstrations import demonstrate, draw_task
    from slapshot.scenes.fetchslide.model import build_scene

    return {"build_scene": build_scene, "demonstrate": demonstrate, "draw_task": draw_task}[name]
