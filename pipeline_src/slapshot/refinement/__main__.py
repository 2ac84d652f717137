"""Stage `refinement`: ranges of randomisation that contain each recorded rig, and its noise level."""

import logging
from typing import Any

import numpy as np
import pandas as pd
import torch
import yaml
from numpy.typing import NDArray

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.method import AdaptationMethod
from slapshot.adaptation.recorded import RecordedTask, recorded_tasks, split_hits
from slapshot.arrays import Array
from slapshot.command import Run, stage_command
from slapshot.config.randomisation import CONDITION_PARAMETERS, Draws
from slapshot.config.refinement import RefinementSettings
from slapshot.errors import InputError
from slapshot.json_types import JsonObject, Row
from slapshot.parquet import write_table
from slapshot.refinement.posterior import metric_of, posterior, quantiles
from slapshot.refinement.summaries import Summaries, summarise, summarise_simulated
from slapshot.rollouts.reading import read_sequences

log = logging.getLogger("slapshot")

NOISE = "noise_variance"
SHARES = (0.05, 0.5, 0.95)
_LEAST_NOISE = 1e-6
# Least width of a refined range over that of the prior: a rig at the edge also needs a range to draw from.
_LEAST_WIDTH = 0.05


def produce(run: Run) -> None:
    """Write refinement.parquet, simulated.parquet, and for every rig a configuration, rig-<rig>.yaml.

    refinement: recording, rig, object, parameter, low, median, high (5, 50 and 95 % quantiles), prior_low,
    prior_high. friction_y is the multiple of friction_x that the configuration draws; noise_variance is that
    of the standardised rest point, the mean of both components. simulated: the same for validation
    conditions, which have no model error; condition replaces recording, rig and object, and truth is added.

    Raises:
        InputError: the rollouts have too few hits of a condition.
    """
    settings = run.settings(RefinementSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    data = read_sequences(run.inputs["rollouts"], "train")
    rng = np.random.default_rng(settings.seed)
    try:
        first, second, noise = summarise_simulated(
            method, standardiser, data, settings.samples, settings.noise_variance_max, rng
        )
    except ValueError as error:
        raise InputError(f"refinement.samples: {error}; lower it or raise rollouts.hits") from None
    prior = Prior(settings.randomisation, settings.noise_variance_max)
    simulated = first, second, prior.parameters(data.conditions), np.log(noise.mean(1) + _LEAST_NOISE)
    held = read_sequences(run.inputs["rollouts"], "validation")
    seen, _, variances = summarise_simulated(
        method, standardiser, held, settings.samples, settings.noise_variance_max, rng
    )
    truths = np.column_stack([np.exp(prior.parameters(held.conditions)), variances.mean(1)])
    tested = [
        {"condition": number, **row, "truth": truth}
        for number, condition in enumerate(truths)
        for row, truth in zip(
            prior.rows(*_refine(seen.only(number), simulated, settings.nearest)), condition, strict=True
        )
    ]
    write_table(pd.DataFrame(tested), run.out / "simulated.parquet")
    rows: list[Row] = []
    for task in recorded_tasks(settings, run.inputs):
        adapt, _ = split_hits(task.hits, settings.samples, settings.repeats, rng, task.where)
        found = _refine(_summaries(method, standardiser, task, adapt), simulated, settings.nearest)
        rows += [
            {"recording": task.recording, "rig": task.rig, "object": task.object, **row}
            for row in prior.rows(*found)
        ]
    table = pd.DataFrame(rows)
    write_table(table, run.out / "refinement.parquet")
    for rig, own in table.groupby("rig"):
        text = yaml.safe_dump(configuration(own, settings.domain, str(rig)), sort_keys=False)
        (run.out / f"rig-{rig}.yaml").write_text(text)
    width = (table["high"] - table["low"]) / (table["prior_high"] - table["prior_low"])
    for parameter, share in width.groupby(table["parameter"]).median().items():
        log.info("%s: ranges of %.0f %% of what was drawn from, in the median", parameter, 100 * share)


class Prior:
    """Prior of the parameters that are drawn uniformly from a range of nonzero width, in logarithms."""

    def __init__(self, randomisation: Draws, noise_variance_max: float) -> None:
        draws = {name: randomisation.of_parameter(name) for name in sorted(CONDITION_PARAMETERS)}
        self._draws = {
            name: draw
            for name, draw in draws.items()
            if draw.uniform is not None and 0 < draw.uniform[0] < draw.uniform[1]
        }
        self._noise = noise_variance_max

    def parameters(self, conditions: pd.DataFrame) -> Array:
        """Logarithms of the parameters of conditions, (conditions, p)."""
        columns = []
        for name, draw in self._draws.items():
            factor = 1.0 if draw.times is None else conditions[draw.times]
            columns.append(np.log((conditions[name] / factor).to_numpy(float)))
        return np.stack(columns, axis=1)

    def rows(self, found: Array, noise: Array) -> list[Row]:
        """Rows of the table from quantiles (SHARES, p) of the parameters and (SHARES,) of the noise.

        Refined ranges stay within the prior's: a model cannot judge parameters that it was not trained on.
        """
        ranges = {name: draw.numbers for name, draw in self._draws.items()} | {NOISE: (0.0, self._noise)}
        values = np.exp(np.column_stack([found, noise]))
        rows = []
        for (name, prior), drawn in zip(ranges.items(), values.T, strict=True):
            low, median, high = np.clip(drawn, *prior)
            least = _LEAST_WIDTH * (prior[1] - prior[0])
            if high - low < least:
                low = float(np.clip(median - least / 2, prior[0], prior[1] - least))
                high = low + least
            rows.append(
                {"parameter": name, "low": low, "median": median, "high": high, "prior_low": prior[0],
                 "prior_high": prior[1]}
            )  # fmt: skip
        return rows


def _summaries(
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
    task: RecordedTask,
    adapt: list[NDArray[np.int64]],
) -> Summaries:
    """Summaries of sequences of a recording's hits, each given by its row numbers in `adapt`."""
    stacked = (
        torch.stack([standardiser.standardise(name, task.data[name][rows]) for rows in adapt])
        for name in ("state", "action", "outcome")
    )
    return summarise(method, *stacked)


def _refine(
    seen: Summaries, simulated: tuple[Summaries, Summaries, Array, Array], nearest: int
) -> tuple[Array, Array]:
    """Quantiles (SHARES, p) of the parameters and (SHARES,) of the noise, as logarithms.

    Quantiles of the mixture over models and over the observed sequences.
    """
    first, second, parameters, noise = simulated
    models, sequences, _ = seen.hidden.shape
    values, errors, weights, error_weights = [], [], [], []
    for model in range(models):
        metric = metric_of(first.hidden[model], second.hidden[model])
        error_metric = metric_of(first.log_error[model][:, None], second.log_error[model][:, None])
        for sequence in range(sequences):
            found = posterior(first.hidden[model], parameters, seen.hidden[model, sequence], metric, nearest)
            values.append(found[0])
            weights.append(found[1])
            told = posterior(
                first.log_error[model][:, None], noise[:, None], seen.log_error[model, sequence, None],
                error_metric, nearest,
            )  # fmt: skip
            errors.append(told[0])
            error_weights.append(told[1])
    return (
        quantiles(np.concatenate(values), np.concatenate(weights), SHARES),
        quantiles(np.concatenate(errors), np.concatenate(error_weights), SHARES)[:, 0],
    )


def configuration(own: pd.DataFrame, domain: str, rig: str) -> JsonObject:
    """Values to override in the default configuration: ranges that contain all objects of one rig."""
    ranges = own.groupby("parameter", sort=False).agg({"low": "min", "high": "max"})
    randomisation = {
        str(name): {"uniform": [_short(row["low"]), _short(row["high"])]}
        for name, row in ranges.iterrows()
        if name != NOISE
    }
    recording = own["recording"].iloc[0]
    return {
        "name": f"refined-{recording}-{rig}",
        "domains": {
            domain: {
                "randomisation": randomisation,
                "training": {"noise_variance_max": _short(ranges.loc[NOISE, "high"])},
            }
        },
    }


def _short(value: Any) -> float:
    return float(f"{float(value):.4g}")


if __name__ == "__main__":
    stage_command("refinement", produce)
