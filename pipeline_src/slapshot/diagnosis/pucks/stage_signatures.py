"""Stage `signatures`: of a pool of commands, shared by all recordings that draw their commands from it."""

import numpy as np

from slapshot.command import Run, stage_command
from slapshot.config.cases import SignaturesSettings
from slapshot.diagnosis.pucks.launch.signatures import LOOK, make_signatures
from slapshot.diagnosis.pucks.launch.strikes import commands_through
from slapshot.effects.catalogue import catalogue, import_effects
from slapshot.parquet import read_table
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion


def produce(run: Run) -> None:
    """Write signatures.safetensors."""
    settings = run.settings(SignaturesSettings)
    scene = Scene.load(run.inputs["scene"])
    import_effects(*settings.effects)
    duration, rate = settings.duration_s, settings.rate_hz
    waypoints = read_table(run.inputs["demonstrations"] / "demonstrations.parquet")["waypoints"]
    times = np.arange(round(duration * rate) + 1) / rate
    rows = []
    for flat in waypoints.to_numpy()[: settings.count]:
        motion = Motion.through(flat.reshape(-1, len(scene.info.joints)).astype(float), duration)
        rows.append(np.column_stack([times, motion.position(times)]))
    commands = commands_through(rows, scene, times[-1] + 2 * LOOK)
    made = make_signatures(scene, commands, catalogue(), run.cores)
    made.save(run.out / "signatures.safetensors")


if __name__ == "__main__":
    stage_command("signatures", produce)
