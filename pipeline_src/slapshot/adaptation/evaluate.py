"""Stage `evaluate`: error against samples on simulated test conditions, for each level of noise."""

import logging

import numpy as np
import pandas as pd
import torch

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.scoring import errors_against_samples
from slapshot.command import Run, stage_command
from slapshot.rollouts.dataset import read_sequences

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write errors.parquet: method, model, condition, name, noise_variance, noise_sd_m, samples, error_m.

    Adaptation samples and queries are different hits of the same condition; both come from latents
    and conditions that training never saw.
    """
    settings = run.config
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    data = read_sequences(run.inputs["rollouts"], "test")
    samples, queries = settings["samples"], settings["queries"]
    names = ("state", "action", "outcome")
    adapt = {name: getattr(data, name)[:, :samples] for name in names}
    query = {name: getattr(data, name)[:, samples : samples + queries] for name in names}
    rng = np.random.default_rng(settings["seed"])
    unit_noise = rng.normal(size=adapt["outcome"].shape)
    spread = float(standardiser.scale["outcome"].square().mean().sqrt())
    tables = []
    for variance in settings["noise_variances"]:
        noise = np.sqrt(variance) * unit_noise
        errors = errors_against_samples(method, standardiser, adapt, query, noise)
        table = error_table(errors, data.conditions[["condition", "name"]])
        tables.append(table.assign(noise_variance=variance, noise_sd_m=np.sqrt(variance) * spread))
        average = errors.mean((0, 1))
        log.info("noise variance %g: %.1f cm before, %.1f cm after %d samples", variance,
                 100 * average[0], 100 * average[-1], samples)  # fmt: skip
    table = pd.concat(tables, ignore_index=True).assign(method=settings["method"])
    table.to_parquet(run.out / "errors.parquet", index=False)


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
