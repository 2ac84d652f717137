"""Table: a box slides on a table; nothing in the scene strikes it. For recordings with tracks only."""

from typing import Any

from slapshot.scenes.table.settings import TableScene as SceneSettings

__all__ = ["SceneSettings", "build_scene", "demonstrate", "draw_task"]


def __getattr__(name: str) -> Any:
    """The functions, imported when they are asked for: who only checks settings must not need MuJoCo."""
    if name not in __all__:
        raise AttributeError(name)
    from slapshot.scenes.table.demonstrations import demonstrate, draw_task
    from slapshot.scenes.table.model import build_scene

    return {"build_scene": build_scene, "demonstrate": demonstrate, "draw_task": draw_task}[name]
