"""Stage `scene`: the domain's MJCF and the names that later stages need."""

from slapshot.command import Run, stage_command
from slapshot.scenes.domain import load_domain


def produce(run: Run) -> None:
    """Write scene.xml and scene.json."""
    load_domain(run.config["domain"]).build_scene(run.config).save(run.out)


if __name__ == "__main__":
    stage_command("scene", produce)
