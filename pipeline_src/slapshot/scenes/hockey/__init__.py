"""Hockey: a KUKA LBR 4+ hits a puck on a whiteboard with a floorball stick (paper, section IV-C)."""

from typing import Any

from slapshot.scenes.hockey.settings import HockeyScene as SceneSettings

__all__ = ["SceneSettings", "build_scene", "demonstrate", "draw_task"]


def __getattr__(name: str) -> Any:
    """The functions, imported when they are asked for: who only checks settings must not need MuJoCo."""
    if name not in __all__:
        raise AttributeError(name)
    from slapshot.scenes.hockey.demonstrations import demonstrate, draw_task
    from slapshot.scenes.hockey.model import build_scene

    return {"build_scene": build_scene, "demonstrate": demonstrate, "draw_task": draw_task}[name]
