"""Stage `evaluate_recording` on a made-up world."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.adaptation import evaluate_recording
from slapshot.command import Run
from slapshot.errors import InputError

MODELS, SAMPLES, REPEATS = 2, 9, 4
TASKS = 4  # two objects on each of two rigs
SETTINGS = {"samples": SAMPLES, "repeats": REPEATS}


@pytest.fixture(scope="module")
def produce(world):
    def run(out: Path, method: str = "kalman", inputs: dict[str, Path] | None = None, **changed):
        out.mkdir()
        config = world.config(method, **SETTINGS) | changed
        evaluate_recording.produce(Run(config, world.inputs(method) | (inputs or {}), out, 1))
        return pd.read_parquet(out / "errors.parquet")

    return run


@pytest.fixture(scope="module")
def errors(produce, tmp_path_factory) -> pd.DataFrame:
    return produce(tmp_path_factory.mktemp("evaluate_recording") / "out")


def test_an_error_for_every_rig_object_repeat_model_and_number_of_samples(errors):
    keys = ["method", "model", "rig", "object", "repeat", "samples"]
    assert set(errors) == {*keys, "error_m", "stand_in"}
    assert not errors.duplicated(keys).any()
    assert len(errors) == MODELS * TASKS * REPEATS * (SAMPLES + 1)
    assert set(errors["rig"]) == {0, 1}
    assert set(errors["object"]) == {"red", "blue"}
    assert errors["stand_in"].all()
    assert (errors["method"] == "kalman").all()


def test_hits_of_the_object_help(errors):
    mean = errors.groupby("samples")["error_m"].mean()
    assert mean[SAMPLES] < 0.6 * mean[0]


def test_splits_are_the_same_for_every_method_and_share_no_command(world, produce, tmp_path, spy):
    calls = spy(evaluate_recording)
    for method in ("kalman", "lstm"):
        produce(tmp_path / method, method)
    adapted = np.split(np.array(calls.adapted), 2)
    predicted = np.split(np.array(calls.predicted), 2)
    assert len(adapted[0]) == TASKS * REPEATS
    assert len(predicted[0]) == TASKS * REPEATS * (SAMPLES + 1)
    for one, other in zip(*adapted, strict=True):
        assert all((one[name] == other[name]).all() for name in one)
    for one, other in zip(*predicted, strict=True):
        assert (one["action"] == other["action"]).all()
    for i, call in enumerate(adapted[0]):
        asked = predicted[0][i * (SAMPLES + 1)]["action"][0]
        seen = call["action"][0]
        assert seen.shape == (SAMPLES, 2)
        # A command's repeats have one action, other commands have others.
        assert np.abs(seen[:, None] - asked).max(-1).min() > 1e-4
        hits = world.hits(i // (2 * REPEATS))
        own = hits[(hits["object_id"] == ("red", "blue")[i // REPEATS % 2]) & hits["rest_x"].notna()]
        latents = np.stack(own["latent"].to_list())
        of_seen_commands = np.abs(latents[:, None] - seen).max(-1).min(1) < 1e-4
        assert SAMPLES <= of_seen_commands.sum() == len(own) - len(asked)
    orders = {call["action"].tobytes() for call in adapted[0]}
    assert len(orders) == TASKS * REPEATS


def test_where_a_query_came_to_rest_changes_no_prediction(world, produce, tmp_path, spy):
    calls = spy(evaluate_recording)
    before = produce(tmp_path / "before", repeats=1)
    first = list(calls.predicted)
    changed = {}
    for rig, folder in enumerate(world.rigs):
        changed[f"lab/lab/{rig}"] = tmp_path / f"rig{rig}"
        shutil.copytree(folder, tmp_path / f"rig{rig}")
        path = tmp_path / f"rig{rig}" / "recording" / "hits.parquet"
        hits = pq.read_table(path)
        latents = np.stack(hits["latent"].to_pylist())
        moved = np.zeros(len(latents), bool)
        for number, name in enumerate(("red", "blue")):
            asked = first[(2 * rig + number) * (SAMPLES + 1)]["action"][0]
            same = np.abs(latents[:, None] - asked).max(-1).min(1) < 1e-4
            moved |= same & (np.array(hits["object_id"].to_pylist()) == name)
        x = hits["rest_x"].to_numpy() + np.where(moved, 5.0, 0.0)
        place = hits.column_names.index("rest_x")
        column = pa.array(x, mask=np.isnan(x))
        pq.write_table(hits.set_column(place, hits.schema.field(place), column), path)
    calls.predicted.clear()
    after = produce(tmp_path / "after", inputs=changed, repeats=1)
    for one, other in zip(first, calls.predicted, strict=True):
        assert (one["outcome"] == other["outcome"]).all()
    # Truths 5 m away: no error can be small, none was large.
    assert after["error_m"].min() > 3 > before["error_m"].max()


def test_a_recording_of_ones_own_is_one_rig(world, produce, tmp_path):
    mine = {"mine": {"path": str(world.rigs[1] / "recording")}}
    table = produce(tmp_path / "out", recordings=mine)
    assert set(table["rig"]) == {0}
    assert len(table) == MODELS * 2 * REPEATS * (SAMPLES + 1)


def test_too_many_samples_are_refused(produce, tmp_path):
    with pytest.raises(InputError, match=r"object red: 23 hits .* too few for 23 samples"):
        produce(tmp_path / "out", samples=23)


def test_the_seed_decides(errors, produce, tmp_path):
    pd.testing.assert_frame_equal(produce(tmp_path / "again"), errors, check_exact=True)
    assert not produce(tmp_path / "other", seed=6)["error_m"].equals(errors["error_m"])
