"""Stage `predictions`: one model's predictions of single hits, before and after adaptation to others."""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.intervals import Calibration, predictive
from slapshot.adaptation.method import AdaptationMethod
from slapshot.adaptation.recorded import recorded_tasks, split_hits
from slapshot.command import Run, stage_command
from slapshot.config.methods import PredictionsSettings
from slapshot.parquet import read_frame, write_table
from slapshot.rollouts.reading import iterate_tracks, read_sequences

log = logging.getLogger("slapshot")

MODEL = 0  # of the ensemble: a picture shows one belief, not four
Arrays = dict[str, NDArray[np.float32]]


def produce(run: Run) -> None:
    """Write predictions.parquet, a row for each hit and number of samples seen.

    Columns: source (simulated, recorded), recording, rig, object, condition, name, hit, samples, model,
    x_m, y_m, cov_xx, cov_xy, cov_yy (m²), radius2_<percent> of each calibrated level, true_x_m, true_y_m.
    Simulated hits are the test hits whose track was kept, predicted after other hits of their condition;
    recorded ones are all hits whose commands were not adapted to.
    """
    settings = run.settings(PredictionsSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    calibration = Calibration(read_frame(run.inputs["calibrate"] / "calibration.parquet"))
    rng = np.random.default_rng(settings.seed)
    most = max(settings.samples)
    tables = []
    for keys, adapt, query in [
        *_simulated(settings, run.inputs["rollouts"], standardiser, most, rng),
        *_recorded(settings, run.inputs, most, rng),
    ]:
        tables.append(_predict(method, standardiser, calibration, keys, adapt, query, settings))
    table = pd.concat(tables, ignore_index=True)
    write_table(table, run.out / "predictions.parquet")
    off = np.hypot(table["x_m"] - table["true_x_m"], table["y_m"] - table["true_y_m"])
    means = 100 * table.assign(off=off).groupby(["source", "samples"])["off"].mean()
    for source in np.unique(table["source"]):
        log.info("%s: %.1f cm before, %.1f cm after %d samples", source, means[source].iloc[0],
                 means[source][most], most)  # fmt: skip


def _simulated(
    settings: PredictionsSettings,
    rollouts: Path,
    standardiser: Standardiser,
    most: int,
    rng: np.random.Generator,
) -> Iterator[tuple[pd.DataFrame, Arrays, Arrays]]:
    """For each test condition: keys of the hits to predict, noisy hits to adapt to, and hits to predict."""
    data = read_sequences(rollouts, "test")
    keys = ["condition", "hit"]
    groups = (t[t["split"] == "test"][keys] for t in iterate_tracks(rollouts))
    tracked = pd.concat([group.drop_duplicates() for group in groups]).drop_duplicates()
    sd = np.sqrt(settings.shown_noise_variance) * standardiser.scale["outcome"].numpy()
    for condition in np.unique(tracked["condition"]):
        shown = tracked.loc[tracked["condition"] == condition, "hit"].to_numpy()
        others = np.setdiff1d(np.arange(data.outcome.shape[1]), shown)
        if len(others) < most:
            continue
        chosen = rng.permutation(others)[:most]
        adapt, query = (
            {name: getattr(data, name)[condition, hits][None] for name in ("state", "action", "outcome")}
            for hits in (chosen, shown)
        )
        noise = (sd * rng.normal(size=adapt["outcome"].shape)).astype(np.float32)
        name = data.conditions["name"].iloc[condition]
        labels = pd.DataFrame({"hit": shown}).assign(
            source="simulated", recording="", rig=-1, object="", condition=condition, name=name
        )
        yield labels, adapt | {"outcome": adapt["outcome"] + noise}, query


def _recorded(
    settings: PredictionsSettings, inputs: Mapping[str, Path], most: int, rng: np.random.Generator
) -> Iterator[tuple[pd.DataFrame, Arrays, Arrays]]:
    """As `_simulated`, for each object of each recorded rig; recorded hits are noisy already."""
    for task in recorded_tasks(settings, inputs):
        (adapt,), (query,) = split_hits(task.hits, most, 1, rng, task.where)
        keys = pd.DataFrame({"hit": task.hits["hit"].to_numpy()[query]}).assign(
            source="recorded",
            recording=task.recording,
            rig=task.rig,
            object=task.object,
            condition=-1,
            name="",
        )
        yield keys, task.take(adapt), task.take(query)


def _predict(
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
    calibration: Calibration,
    keys: pd.DataFrame,
    adapt: Arrays,
    query: Arrays,
    settings: PredictionsSettings,
) -> pd.DataFrame:
    def tensor(values: Arrays, name: str) -> torch.Tensor:
        standardised = standardiser.standardise(name, values[name])
        return standardised.expand(method.models, *standardised.shape)

    with torch.no_grad():
        beliefs = method.adapt(*(tensor(adapt, name) for name in ("state", "action", "outcome")))
    generator = torch.Generator().manual_seed(settings.seed)
    tables = []
    for samples in settings.samples:
        predicted = predictive(method, standardiser, beliefs[samples], tensor(query, "state"),
                               tensor(query, "action"), settings.draws, generator)  # fmt: skip
        mean, covariance = predicted.mean[MODEL, 0].numpy(), predicted.covariance[MODEL, 0].numpy()
        levels = calibration.table["level"].unique()
        tables.append(
            keys.assign(
                samples=samples,
                model=MODEL,
                x_m=mean[:, 0],
                y_m=mean[:, 1],
                cov_xx=covariance[:, 0, 0],
                cov_xy=covariance[:, 0, 1],
                cov_yy=covariance[:, 1, 1],
                true_x_m=query["outcome"][0, :, 0],
                true_y_m=query["outcome"][0, :, 1],
                **{f"radius2_{100 * p:g}": calibration.radius2(MODEL, samples, p) for p in levels},
            )
        )
    return pd.concat(tables, ignore_index=True)


if __name__ == "__main__":
    stage_command("predictions", produce)
