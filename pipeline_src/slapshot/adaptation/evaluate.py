"""Stage `evaluate`: error against samples on simulated test conditions, for each noise level."""

import logging

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.scoring import errors_against_samples
from slapshot.command import Run, stage_command
from slapshot.config.methods import EvaluateSettings
from slapshot.parquet import write_table
from slapshot.rollouts.reading import read_sequences

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write errors.parquet.

    Columns: method, model, condition, name, repeat, noise_variance, noise_sd_m, samples, error_m.
    Adaptation samples and queries are different hits of the same condition, split at random in each
    repeat; both come from latents and conditions that training never saw.
    """
    settings = run.settings(EvaluateSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    data = read_sequences(run.inputs["rollouts"], "test")
    samples, queries = settings.samples, settings.queries
    rng = np.random.default_rng(settings.seed)
    spread = float(standardiser.scale["outcome"].square().mean().sqrt())
    tables = []
    for repeat in range(settings.repeats):
        order = rng.permuted(np.tile(np.arange(data.outcome.shape[1]), (len(data.conditions), 1)), axis=1)
        adapt, query = (
            {name: _take(getattr(data, name), rows) for name in ("state", "action", "outcome")}
            for rows in (order[:, :samples], order[:, samples : samples + queries])
        )
        unit_noise = rng.normal(size=adapt["outcome"].shape)
        for variance in settings.noise_variances:
            noise = np.sqrt(variance) * unit_noise
            errors = errors_against_samples(method, standardiser, adapt, query, noise)
            table = error_table(errors, data.conditions[["condition", "name"]].assign(repeat=repeat))
            tables.append(table.assign(noise_variance=variance, noise_sd_m=np.sqrt(variance) * spread))
    table = pd.concat(tables, ignore_index=True).assign(method=settings.method)
    write_table(table, run.out / "errors.parquet")
    for level, rows in table.groupby("noise_variance"):
        mean = 100 * rows.groupby("samples")["error_m"].mean()
        log.info("noise variance %g: %.1f cm before, %.1f cm after %d samples", level, mean[0],
                 mean[samples], samples)  # fmt: skip


def _take(values: NDArray[np.float32], rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """(conditions, n, size): hits of each condition, selected by the indices `rows` (conditions, n)."""
    return np.take_along_axis(values, rows[:, :, None], 1)


def error_table(errors: np.ndarray, tasks: pd.DataFrame) -> pd.DataFrame:
    """Long table of errors (models, tasks, samples + 1) in m, with the tasks' own columns."""
    models, count, steps = errors.shape
    index = pd.MultiIndex.from_product(
        [range(models), range(count), range(steps)], names=["model", "task", "samples"]
    )
    table = pd.DataFrame({"error_m": errors.ravel().astype(np.float32)}, index=index).reset_index()
    return table.join(tasks.reset_index(drop=True), on="task").drop(columns="task")


if __name__ == "__main__":
    stage_command("evaluate", produce)
