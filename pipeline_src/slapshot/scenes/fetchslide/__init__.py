"""FetchSlide: a Fetch robot's gripper pushes a puck away over a table (paper, section IV-B).

MJCF and meshes are those of the gymnasium-robotics package; the robot is commanded as there, by the velocity
of its gripper, so this folder has its own parts: safety, execution and collector.
"""

from slapshot.scenes.fetchslide.demonstrations import demonstrate, draw_task
from slapshot.scenes.fetchslide.model import build_scene

__all__ = ["build_scene", "demonstrate", "draw_task"]
