"""Stage `calibrate` on a made-up world: what it measures on which hits, and that nothing leaks."""

import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.adaptation import calibrate
from slapshot.adaptation.intervals import raw_radius2
from slapshot.command import Run
from slapshot.rollouts.reading import read_sequences

MODELS, CONDITIONS, SAMPLES, QUERIES = 2, 22, [0, 2, 8], 6
LEVELS, VARIANCES, VARIANCE_MAX = [0.5, 0.9], [0.0, 0.1, 0.4], 0.2
SETTINGS = {
    "seed": 5, "method": "kalman", "draws": 24, "levels": LEVELS, "samples": SAMPLES, "queries": QUERIES,
    "noise_variances": VARIANCES, "noise_variance_max": VARIANCE_MAX,
}  # fmt: skip


def produce(world, out: Path, rollouts: Path | None = None, **changed) -> dict[str, pd.DataFrame]:
    out.mkdir()
    inputs = {"train": world.kalman, "rollouts": rollouts or world.rollouts}
    calibrate.produce(Run({**SETTINGS, **changed}, inputs, out, 1))
    return {name: pd.read_parquet(out / f"{name}.parquet") for name in ("calibration", "coverage")}


@pytest.fixture(scope="module")
def tables(world, tmp_path_factory) -> dict[str, pd.DataFrame]:
    return produce(world, tmp_path_factory.mktemp("calibrate") / "out")


def actions(values: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(row) for row in values.reshape(-1, values.shape[-1]).tolist()}


def changed_split(world, folder: Path, split: str, outcome: np.ndarray) -> Path:
    """Rollouts with other outcomes in one split."""
    shutil.copytree(world.rollouts, folder)
    table = pq.read_table(folder / f"hits-{split}.parquet")
    column = pa.FixedSizeListArray.from_arrays(pa.array(outcome.astype(np.float32).ravel()), 2)
    pq.write_table(table.set_column(2, "outcome", column), folder / f"hits-{split}.parquet")
    return folder


def test_a_row_for_every_model_level_and_number_of_samples(tables):
    radii, coverage = tables["calibration"], tables["coverage"]
    assert list(radii) == ["model", "samples", "level", "radius2"]
    assert len(radii) == MODELS * len(SAMPLES) * len(LEVELS)
    assert not radii.duplicated(["model", "samples", "level"]).any()
    keys = ["model", "noise_variance", "samples", "level", "kind"]
    assert list(coverage) == [*keys, "coverage", "area_m2"]
    assert len(coverage) == MODELS * (1 + len(VARIANCES)) * len(SAMPLES) * len(LEVELS) * 2
    assert not coverage.duplicated(keys).any()
    assert set(coverage["noise_variance"].dropna()) == set(VARIANCES)


def test_the_measured_radius_is_the_one_that_is_used(tables):
    radii = tables["calibration"].set_index(["model", "samples", "level"])["radius2"]
    keys = ["model", "noise_variance", "samples", "level"]
    area = tables["coverage"].fillna(-1).set_index([*keys, "kind"])["area_m2"].unstack("kind")
    for (model, _, samples, level), row in area.iterrows():
        # Areas of ellipses of one shape are as their squared radii.
        measured = radii[model, samples, level]
        assert row["calibrated"] / row["raw"] == pytest.approx(measured / raw_radius2(level))
    wide = tables["coverage"].fillna(-1).pivot(index=[*keys[:3], "kind"], columns="level", values="coverage")
    assert (wide[0.9] >= wide[0.5]).all()


def test_on_the_data_it_was_measured_on_it_covers_its_level(world, tmp_path):
    """Validation data in the place of test data: the share inside is the quantile's, to one in n."""
    rollouts = tmp_path / "rollouts"
    shutil.copytree(world.rollouts, rollouts)
    shutil.copy(rollouts / "hits-validation.parquet", rollouts / "hits-test.parquet")
    conditions = pd.read_parquet(rollouts / "conditions.parquet")
    conditions = conditions[conditions["split"] != "test"]
    copied = conditions[conditions["split"] == "validation"].assign(split="test")
    pd.concat([conditions, copied]).to_parquet(rollouts / "conditions.parquet")
    coverage = produce(world, tmp_path / "out", rollouts)["coverage"]
    trained = coverage[coverage["noise_variance"].isna() & (coverage["kind"] == "calibrated")]
    n = len(copied) * QUERIES
    assert len(trained) == MODELS * len(SAMPLES) * len(LEVELS)
    assert (trained["coverage"] - trained["level"]).abs().max() < 1.001 / n


def test_on_test_conditions_it_comes_near_its_level(tables):
    coverage = tables["coverage"]
    trained = coverage[coverage["noise_variance"].isna() & (coverage["kind"] == "calibrated")]
    off = (trained["coverage"] - trained["level"]).abs()
    # As if the hits of a condition were one: 22 conditions, radii from 40. Five standard errors.
    error = np.sqrt(trained["level"] * (1 - trained["level"]) * (1 / CONDITIONS + 1 / 40))
    assert (off < 5 * error).all()
    # Squared error leaves the belief's scale free: raw radii are off by more, or nothing needs calibration.
    raw = coverage[
        coverage["noise_variance"].isna() & (coverage["kind"] == "raw") & (coverage["samples"] == 8)
    ]
    assert (raw["coverage"] - raw["level"]).abs().max() > 0.1


def test_hits_to_adapt_to_and_hits_to_predict_are_different_ones(world, tmp_path, spy):
    calls = spy(calibrate)
    produce(world, tmp_path / "out")
    # Validation, then test with the noise of training and with each level.
    assert len(calls.adapted) == 1 + 1 + len(VARIANCES)
    assert len(calls.predicted) == len(calls.adapted) * len(SAMPLES)
    known = {split: read_sequences(world.rollouts, split).action for split in ("validation", "test")}
    for i, adapted in enumerate(calls.adapted):
        queries = [call["action"] for call in calls.predicted[i * len(SAMPLES) : (i + 1) * len(SAMPLES)]]
        everything = known["test" if i else "validation"]
        assert all((q == queries[0]).all() for q in queries)
        for condition, (seen, asked) in enumerate(zip(adapted["action"], queries[0], strict=True)):
            assert len(actions(seen)) == max(SAMPLES)
            assert len(actions(asked)) == QUERIES
            assert not actions(seen) & actions(asked)
            # Of this very condition; standardising and back costs the last digits of float32.
            off = np.abs(np.concatenate([seen, asked])[:, None] - everything[condition]).max(-1).min(1)
            assert off.max() < 1e-4


def test_noise_has_the_variance_that_is_asked_for_in_units_of_the_standardised_outcome(world, tmp_path, spy):
    calls = spy(calibrate)
    produce(world, tmp_path / "out")
    data = read_sequences(world.rollouts, "test")
    scale = read_sequences(world.rollouts, "train").outcome.reshape(-1, 2).std(0, ddof=1)
    noise = []
    for call in calls.adapted[1:]:
        row = np.abs(call["action"][:, :, None] - data.action[:, None]).max(-1).argmin(2)
        truth = np.take_along_axis(data.outcome, row[..., None], 1)
        noise.append((call["observed"] - truth) / scale)
    drawn, levels = noise[0], dict(zip(VARIANCES, noise[1:], strict=True))
    n = levels[0.1].size
    assert np.abs(levels[0.0]).max() < 1e-4
    for variance in (0.1, 0.4):
        # The mean square of n normal draws: v, give or take v sqrt(2 / n).
        assert (levels[variance] ** 2).mean() == pytest.approx(variance, abs=5 * variance * math.sqrt(2 / n))
    # The same noise at every level, so that levels can be compared.
    assert levels[0.4] == pytest.approx(2 * levels[0.1], abs=1e-3)
    # Training's variances are drawn for each condition and component from U(0, v): mean square v / 2, with
    # a variance of v² / 12 over conditions and 2 v² / 3 of single squares.
    spread = VARIANCE_MAX * math.sqrt(1 / 12 / (2 * CONDITIONS) + 2 / 3 / n)
    assert (drawn**2).mean() == pytest.approx(VARIANCE_MAX / 2, abs=5 * spread)
    assert drawn.std(1).max() > 3 * drawn.std(1).min()


def test_what_became_of_a_query_changes_no_prediction(world, tmp_path, spy):
    calls = spy(calibrate)
    before = produce(world, tmp_path / "before")
    levels = slice(2 * len(SAMPLES), None)  # they share one split, which is not that of training's noise
    first = [call["outcome"] for call in calls.predicted[levels]]
    asked = actions(np.concatenate([call["action"] for call in calls.predicted[levels]]))
    data = read_sequences(world.rollouts, "test")
    near = np.array(sorted(asked))
    queried = (np.abs(data.action[:, :, None] - near).max(-1) < 1e-4).any(2)
    assert 0 < queried.mean() < 1
    moved = data.outcome + np.where(queried, 10.0, 0.0)[..., None]
    rollouts = changed_split(world, tmp_path / "rollouts", "test", moved)
    calls.predicted.clear()
    after = produce(world, tmp_path / "after", rollouts)
    for one, other in zip(first, calls.predicted[levels], strict=True):
        assert (one == other["outcome"]).all()
    assert after["calibration"].equals(before["calibration"])
    before, after = (tables["coverage"].dropna() for tables in (before, after))
    assert after["area_m2"].equals(before["area_m2"])
    assert after["coverage"].max() < before["coverage"].max()


def test_the_seed_decides(world, tables, tmp_path):
    again = produce(world, tmp_path / "again")
    other = produce(world, tmp_path / "other", seed=6)
    for name, table in tables.items():
        pd.testing.assert_frame_equal(again[name], table, check_exact=True)
        assert not other[name].equals(table)
