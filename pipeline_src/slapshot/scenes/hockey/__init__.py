"""Hockey: a KUKA LBR 4+ hits a puck on a whiteboard with a floorball stick (paper, section IV-C)."""

from slapshot.scenes.hockey.demonstrations import demonstrate, draw_task
from slapshot.scenes.hockey.model import build_scene

__all__ = ["build_scene", "demonstrate", "draw_task"]
