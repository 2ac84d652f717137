"""Stage `exploration`: error against samples, for hits chosen by a belief and for randomly sampled hits."""

import logging

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.recorded import RecordedTask, recorded_tasks, split_hits
from slapshot.command import Run, stage_command
from slapshot.config.acting import ExplorationSettings
from slapshot.goal_reaching.ensemble import load_believing
from slapshot.goal_reaching.explore import at_random, explore, informed
from slapshot.parquet import write_table

log = logging.getLogger("slapshot")

INFORMED, SAMPLED = "informed", "sampled"
_NAMES = ("state", "action", "outcome")


def produce(run: Run) -> None:
    """Write exploration.parquet: recording, rig, object, stand_in, arm, repeat, model, samples, error_m.

    In each repeat a recording's hits are split at random into candidates and hits to predict, without a
    common command; both arms choose among the same candidates.

    Raises:
        InputError: the method has no belief from which to compute uncertainty.
    """
    settings = run.settings(ExplorationSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_believing(run.inputs["train"])
    tables = []
    for number, task in enumerate(recorded_tasks(settings, run.inputs)):
        rng = np.random.default_rng([settings.seed, number])
        errors = _errors(method, standardiser, task, settings, rng)
        tables.append(
            errors.assign(recording=task.recording, rig=task.rig, object=task.object, stand_in=task.stand_in)
        )
    table = pd.concat(tables, ignore_index=True)
    write_table(table, run.out / "exploration.parquet")
    means = 100 * table.groupby(["samples", "arm"])["error_m"].mean().unstack("arm")
    log.info("cm after 1, 2, 4, ... samples:\n%s", means.loc[[n for n in means.index if n & (n - 1) == 0]])


def _errors(
    method: Kalman,
    standardiser: Standardiser,
    task: RecordedTask,
    settings: ExplorationSettings,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Errors of one task; its repeats are the ensemble's batch of tasks."""
    adapt, query = split_hits(task.hits, settings.candidates, settings.repeats, rng, task.where)
    candidates = {name: _stacked(standardiser, task, name, adapt, method.models) for name in _NAMES}
    asked = (
        candidates["state"][:, :, :1].expand(-1, -1, settings.asked, -1),
        _sampled(standardiser, settings.asked, rng).expand(method.models, len(adapt), -1, -1),
    )
    generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
    parts = []
    for arm, choose in ((INFORMED, informed(method, candidates, asked)), (SAMPLED, at_random(generator))):
        beliefs = explore(method, candidates, choose, settings.samples)
        parts.append(_table(_scores(method, standardiser, beliefs, task, query)).assign(arm=arm))
    return pd.concat(parts, ignore_index=True)


def _stacked(
    standardiser: Standardiser, task: RecordedTask, name: str, rows: list[NDArray[np.int64]], models: int
) -> Tensor:
    """Standardised values of the selected hits, (M, repeats, hits, size)."""
    values = torch.stack([standardiser.standardise(name, task.data[name][r]) for r in rows])
    return values.expand(models, *values.shape)


def _sampled(standardiser: Standardiser, count: int, rng: np.random.Generator) -> Tensor:
    """Standardised actions (count, latent) of latents drawn from the unit Gaussian."""
    size = len(standardiser.mean["action"])
    return standardiser.standardise("action", rng.normal(size=(count, size)))


def _scores(
    method: Kalman,
    standardiser: Standardiser,
    beliefs: list[KalmanBelief],
    task: RecordedTask,
    query: list[NDArray[np.int64]],
) -> NDArray[np.float64]:
    """Mean distance in m, (M, repeats, samples + 1); repeats differ in the number of predicted hits."""
    scores = np.empty((method.models, len(query), len(beliefs)))
    for repeat, rows in enumerate(query):
        state, action = (
            _stacked(standardiser, task, name, [rows], method.models) for name in ("state", "action")
        )
        truth = torch.as_tensor(task.data["outcome"][rows], dtype=torch.float32)
        one = slice(repeat, repeat + 1)
        for samples, belief in enumerate(beliefs):
            own = KalmanBelief(belief.mean[:, one], belief.covariance[:, one])
            with torch.no_grad():
                predicted = standardiser.restore("outcome", method.predict(own, state, action))
            scores[:, repeat, samples] = (predicted - truth).norm(dim=-1).mean(-1)[:, 0].numpy()
    return scores


def _table(scores: NDArray[np.float64]) -> pd.DataFrame:
    numbers = [range(n) for n in scores.shape]
    index = pd.MultiIndex.from_product(numbers, names=["model", "repeat", "samples"])
    return pd.DataFrame({"error_m": scores.ravel()}, index=index).reset_index()


if __name__ == "__main__":
    stage_command("exploration", produce)
