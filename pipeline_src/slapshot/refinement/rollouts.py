"""Stage `refined_rollouts`: rollouts whose conditions are drawn from one rig's refined ranges."""

from slapshot.command import Run, stage_command
from slapshot.config.refinement import RefinedRolloutsSettings
from slapshot.config.rollouts import RolloutsSettings
from slapshot.refinement.refined import narrowed, refined_settings
from slapshot.rollouts.__main__ import simulate


def produce(run: Run) -> None:
    """Write the same files as the stage `rollouts`."""
    told = run.settings(RefinedRolloutsSettings)
    refined = refined_settings(run.inputs["refinement"], told.name, told.rig)
    randomisation = narrowed(told.randomisation, refined)
    simulate(RolloutsSettings.from_parts(told, randomisation=randomisation), run.inputs, run.out, run.cores)


if __name__ == "__main__":
    stage_command("refined_rollouts", produce, resume=True)
