"""Stage `evaluate_recording`: error against samples on recordings, real or stand-in."""

import logging

import numpy as np
import pandas as pd
import torch

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.evaluate import error_table
from slapshot.adaptation.recorded import recorded_tasks, split_hits
from slapshot.adaptation.scoring import errors_against_samples
from slapshot.command import Run, stage_command
from slapshot.config.methods import EvaluateRecordingSettings
from slapshot.parquet import write_table

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write errors.parquet: method, model, rig, object, repeat, samples, error_m, stand_in.

    Each repeat splits an object's commands at random: hits of some commands are adapted to, in random
    order, hits of the other commands are scored. The splits are the same for every method.
    """
    settings = run.settings(EvaluateRecordingSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    rng = np.random.default_rng(settings.seed)
    tables = []
    for task in recorded_tasks(settings, run.inputs):
        adapt, query = split_hits(task.hits, settings.samples, settings.repeats, rng, task.where)
        for repeat in range(settings.repeats):
            errors = errors_against_samples(
                method, standardiser, task.take(adapt[repeat]), task.take(query[repeat])
            )
            labels = pd.DataFrame({"rig": [task.rig], "object": [task.object], "repeat": [repeat]})
            tables.append(error_table(errors, labels).assign(stand_in=task.stand_in))
    table = pd.concat(tables, ignore_index=True).assign(method=settings.method)
    write_table(table, run.out / "errors.parquet")
    means = table.groupby("samples")["error_m"].mean()
    log.info("%.1f cm before, %.1f cm after %d samples", 100 * means.iloc[0],
             100 * means.iloc[-1], means.index[-1])  # fmt: skip


if __name__ == "__main__":
    stage_command("evaluate_recording", produce)
