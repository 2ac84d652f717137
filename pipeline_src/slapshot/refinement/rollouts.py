"""Stage `refined_rollouts`: rollouts whose conditions are drawn from one rig's refined ranges."""

from dataclasses import replace

from slapshot.command import Run, stage_command
from slapshot.refinement.refined import narrowed, refined_settings
from slapshot.rollouts.__main__ import produce as produce_rollouts


def produce(run: Run) -> None:
    """Write what the stage `rollouts` writes."""
    settings = dict(run.config)
    refined = refined_settings(run.inputs["refinement"], settings.pop("name"), settings.pop("rig"))
    settings["randomisation"] = narrowed(settings["randomisation"], refined["randomisation"])
    produce_rollouts(replace(run, config=settings))


if __name__ == "__main__":
    stage_command("refined_rollouts", produce, resume=True)
