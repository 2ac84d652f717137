"""Stage `scene`: the domain's MJCF and the names of its elements that later stages need."""

from slapshot.command import Run, stage_command
from slapshot.config.scene import OwnScene
from slapshot.scenes.domain import build_scene


def produce(run: Run) -> None:
    """Write scene.xml and scene.json."""
    build_scene(run.settings(OwnScene)).save(run.out)


if __name__ == "__main__":
    stage_command("scene", produce)
