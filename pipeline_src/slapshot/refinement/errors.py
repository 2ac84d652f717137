"""Stage `refined_errors`: new hits on a rig, predicted by models trained on full and on refined ranges."""

import logging

import numpy as np
import pandas as pd
import torch

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.evaluate import error_table
from slapshot.adaptation.recorded import recorded_tasks
from slapshot.adaptation.scoring import errors_against_samples
from slapshot.command import Run, stage_command
from slapshot.config.refinement import RefinedErrorsSettings
from slapshot.goal_reaching.rigs import robot_of, sampled_hits
from slapshot.parquet import write_table

log = logging.getLogger("slapshot")

ALL_RANGES, REFINED = "all ranges", "refined ranges"


def produce(run: Run) -> None:
    """Write errors.parquet: arm, model, rig, object, repeat, samples, error_m.

    New hits with sampled latents are made on the rig, because its recorded hits were used to refine the
    ranges. Each repeat splits the new hits at random, in the same way for both arms.
    """
    settings = run.settings(RefinedErrorsSettings)
    torch.set_num_threads(run.cores)
    robot = robot_of(settings, run.inputs, run.cores)
    rng = np.random.default_rng([settings.seed, settings.rig, 3])
    arms = {
        arm: load_ensemble(run.inputs[role]) for arm, role in ((ALL_RANGES, "train"), (REFINED, "refined"))
    }
    tables = []
    for task in recorded_tasks(settings, run.inputs):
        count = settings.samples + settings.queries
        hits = sampled_hits(robot, task, count, rng)
        orders = np.array([rng.permutation(count) for _ in range(settings.repeats)])
        adapt, query = (
            {name: values[rows] for name, values in hits.items()}
            for rows in np.split(orders, [settings.samples], axis=1)
        )
        labels = pd.DataFrame({"repeat": range(len(orders)), "rig": settings.rig, "object": task.object})
        for arm, (method, standardiser) in arms.items():
            errors = errors_against_samples(method, standardiser, adapt, query)
            tables.append(error_table(errors, labels).assign(arm=arm))
    table = pd.concat(tables, ignore_index=True)
    write_table(table, run.out / "errors.parquet")
    means = 100 * table.groupby(["arm", "samples"])["error_m"].mean().unstack("arm")
    log.info("cm after 0, 1, 2, 4, ... samples:\n%s", means.loc[[n for n in means.index if n & (n - 1) == 0]])


if __name__ == "__main__":
    stage_command("refined_errors", produce)
