"""Stage `arm_rollouts`: rollouts of one arm, in the format of the stage `rollouts`."""

import json
import logging

import numpy as np
import pyarrow as pa

from slapshot.command import Run, stage_command
from slapshot.config.retraining import ArmRolloutsSettings
from slapshot.config.rollouts import DrawnRollouts
from slapshot.diagnosis.pucks.augmented import AUGMENTED, EFFECTS_FILE, effects_of
from slapshot.diagnosis.pucks.refit import REFIT_FILE
from slapshot.diagnosis.pucks.rig_file import camera_foot
from slapshot.effects.catalogue import import_effects
from slapshot.errors import InputError
from slapshot.progress import progress
from slapshot.retraining.collector import AugmentedCollector, swings_with_effects
from slapshot.retraining.ranges import refitted_ranges
from slapshot.rollouts.dataset import hits_table, write_atomically
from slapshot.rollouts.plan import RolloutPlan
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import SPLITS, Swings
from slapshot.trajectories.vae import TrajectoryVae
from slapshot.validation import values_of

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write hits-<split>.parquet, conditions.parquet, ranges.json and effects.json.

    Raises:
        InputError: the diagnosis had insufficient data.
    """
    settings, findings = run.settings(ArmRolloutsSettings), run.inputs["findings"]
    if not (findings / REFIT_FILE).is_file():
        raise InputError(
            f"{findings}: the diagnosis could not tell anything of that recording (see its verdict.md); "
            "name another one under retraining.recording"
        )
    refit = json.loads((findings / REFIT_FILE).read_text())
    ranges = refitted_ranges(settings.randomisation, refit, settings.margin)
    scene, swings = Scene.load(run.inputs["scene"]), Swings.load(run.inputs["swings"])
    values: dict[str, dict[str, float]] = {}
    found = findings / AUGMENTED
    if settings.arm == "augmented" and found.is_dir():
        import_effects(*settings.effects)
        values = json.loads((found / EFFECTS_FILE).read_text())
        scene = Scene.load(found)
    effects = effects_of(values)
    if effects:
        model = TrajectoryVae.load(run.inputs["trajectory_model"])
        swings = swings_with_effects(swings, model, scene, effects, run.cores)
    plan = RolloutPlan(DrawnRollouts.from_parts(settings, randomisation=ranges), swings)
    collector = AugmentedCollector(scene, swings, effects, np.array(camera_foot(scene)), run.cores)
    shards = plan.shards()
    tables: dict[str, list[pa.Table]] = {split: [] for split in SPLITS}
    for shard in progress(shards, len(shards), "rollout shards"):
        hits, _ = plan.hits_of(shard)
        outcomes = collector.collect(hits)
        tables[shard.split].append(hits_table(hits, outcomes, swings, shard.conditions))
    for split, parts in tables.items():
        write_atomically(pa.concat_tables(parts), run.out / f"hits-{split}.parquet")
    conditions = pa.Table.from_pandas(plan.conditions(), preserve_index=False)
    write_atomically(conditions, run.out / "conditions.parquet")
    for name, told in (
        ("ranges.json", values_of(ranges)),
        (EFFECTS_FILE, values),
    ):
        (run.out / name).write_text(json.dumps(told, indent=2, sort_keys=True) + "\n")
    log.info("with %s", ", ".join(values) or "no effect")


if __name__ == "__main__":
    stage_command("arm_rollouts", produce)
