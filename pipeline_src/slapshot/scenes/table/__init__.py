"""Table: a box slides on a table; nothing in the scene strikes it. For recordings with tracks only."""

from slapshot.scenes.table.demonstrations import demonstrate, draw_task
from slapshot.scenes.table.model import build_scene

__all__ = ["build_scene", "demonstrate", "draw_task"]
