"""Stage `calibrate`: calibrated radii of prediction intervals, and their coverage on test data."""

import logging
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.intervals import calibrate, predictive, raw_radius2
from slapshot.adaptation.method import AdaptationMethod
from slapshot.command import Run, stage_command
from slapshot.config.methods import CalibrateSettings
from slapshot.parquet import write_table
from slapshot.rollouts.reading import Sequences, read_sequences

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write calibration.parquet and coverage.parquet.

    calibration: model, samples, level, radius2; measured on the validation conditions with the noise of
    training. coverage: model, noise_variance (NaN: that of training), samples, level, kind (raw or
    calibrated), coverage, area_m2 (median); measured on the test conditions.
    """
    settings = run.settings(CalibrateSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    levels = settings.levels
    validation = read_sequences(run.inputs["rollouts"], "validation")
    radii = pd.concat(
        [
            pd.DataFrame({"model": range(method.models), "samples": samples, "level": level,
                          "radius2": calibrate(distances, level)})
            for samples, distances, _ in _distances(method, standardiser, validation, settings, None)
            for level in levels
        ],
        ignore_index=True,
    )  # fmt: skip
    write_table(radii, run.out / "calibration.parquet")
    test = read_sequences(run.inputs["rollouts"], "test")
    rows = []
    for variance in (None, *settings.noise_variances):
        for samples, distances, areas in _distances(method, standardiser, test, settings, variance):
            for level in levels:
                measured = radii[(radii["samples"] == samples) & (radii["level"] == level)][
                    "radius2"
                ].to_numpy()
                for kind, radius2 in (
                    ("raw", np.full(method.models, raw_radius2(level))),
                    ("calibrated", measured),
                ):
                    rows.append(
                        pd.DataFrame({
                            "model": range(method.models),
                            "noise_variance": np.nan if variance is None else variance,
                            "samples": samples,
                            "level": level,
                            "kind": kind,
                            "coverage": (distances <= radius2[:, None, None]).mean((1, 2)),
                            "area_m2": np.median(areas, axis=(1, 2)) * radius2,
                        })
                    )  # fmt: skip
    coverage = pd.concat(rows, ignore_index=True)
    write_table(coverage, run.out / "coverage.parquet")
    trained = (
        coverage[coverage["noise_variance"].isna()].groupby(["level", "samples", "kind"])["coverage"].mean()
    )
    for (level, samples), values in trained.unstack().iterrows():  # type: ignore[misc]
        log.info("%2.0f %% interval after %2d samples covers %.0f %% raw, %.0f %% calibrated", 100 * level,
                 samples, 100 * values["raw"], 100 * values["calibrated"])  # fmt: skip


def _distances(
    method: AdaptationMethod[Any],
    standardiser: Standardiser,
    data: Sequences,
    settings: CalibrateSettings,
    variance: float | None,
) -> list[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
    """For each number of samples: that number, squared Mahalanobis distances and unit areas, each (M, B, Q).

    Hits to adapt to and hits to predict are disjoint. The noise has the given variance, or is drawn as in
    training if `variance` is None.
    """
    rng = np.random.default_rng([settings.seed, 0 if variance is None else 1])
    count, hits, size = data.outcome.shape
    most, queries = max(settings.samples), settings.queries
    order = rng.permuted(np.tile(np.arange(hits), (count, 1)), axis=1)[:, : most + queries, None]
    taken = {n: np.take_along_axis(getattr(data, n), order, 1) for n in ("state", "action", "outcome")}
    drawn = rng.uniform(0, settings.noise_variance_max, (count, 1, size))
    spread = np.sqrt(drawn if variance is None else variance)
    noise = torch.as_tensor(spread * rng.normal(size=(count, most, size)), dtype=torch.float32)
    tensors = {n: standardiser.standardise(n, v).expand(method.models, *v.shape) for n, v in taken.items()}
    state, action = tensors["state"], tensors["action"]
    with torch.no_grad():
        beliefs = method.adapt(
            state[:, :, :most], action[:, :, :most], tensors["outcome"][:, :, :most] + noise
        )
    truth = torch.as_tensor(taken["outcome"][:, most:])
    generator = torch.Generator().manual_seed(settings.seed)
    found = []
    for samples in settings.samples:
        predicted = predictive(method, standardiser, beliefs[samples], state[:, :, most:],
                               action[:, :, most:], settings.draws, generator)  # fmt: skip
        found.append((samples, predicted.squared_distance(truth).numpy(), predicted.area().numpy()))
    return found


if __name__ == "__main__":
    stage_command("calibrate", produce)
