"""Training and evaluation as stages, on a made-up dataset whose outcome is condition times action."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from slapshot.adaptation import evaluate, train
from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.command import Run

HITS = 24


@pytest.fixture(scope="module")
def rollouts(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("rollouts")
    rng = np.random.default_rng(0)
    rows, number = [], {"train": 200, "validation": 20, "test": 12}
    for split, count in number.items():
        slope = rng.uniform(-1, 1, count)
        action = rng.normal(size=(count, HITS, 1)).astype(np.float32)
        outcome = (slope[:, None, None] * np.concatenate([action, -action], 2)).astype(np.float32)

        def column(values):
            flat = pa.array(values.reshape(-1))
            return pa.FixedSizeListArray.from_arrays(flat, values.shape[-1])

        table = pa.table(
            {"state": column(np.zeros((count, HITS, 2), np.float32)), "action": column(action),
             "outcome": column(outcome)}
        )  # fmt: skip
        pq.write_table(table, folder / f"hits-{split}.parquet")
        rows.append(pd.DataFrame({"split": split, "condition": range(count), "name": ""}))
    pd.concat(rows).to_parquet(folder / "conditions.parquet", index=False)
    return folder


def settings(steps=300):
    training = {
        "seed": 1, "models": 2, "steps": steps, "tasks": 32, "sequence": 12,
        "noise_variance_max": 0.1, "learning_rate": 5e-3,
    }  # fmt: skip
    return {
        "method": "kalman",
        "settings": {"latent": 4, "hidden": [32], "drift": 1e-4},
        "training": training,
    }


@pytest.fixture(scope="module")
def trained(rollouts, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("train")
    train.produce(Run(settings(), {"rollouts": rollouts}, folder, 2))
    return folder


def test_training_learns_and_says_so(trained):
    losses = pd.read_csv(trained / "losses.csv")
    assert set(losses["model"]) == {0, 1}
    last = losses[losses["step"] == losses["step"].max()]["validation"]
    first = losses[losses["step"] == 0]["validation"]
    assert last.max() < 0.5 * first.min()


def test_nothing_is_pickled(trained):
    assert {p.suffix for p in trained.iterdir()} <= {".safetensors", ".json", ".csv"}


def test_checkpoint_predicts_as_before_and_seeds_decide(trained, rollouts, tmp_path):
    method, _ = load_ensemble(trained)
    again = tmp_path / "again"
    again.mkdir()
    train.produce(Run(settings(), {"rollouts": rollouts}, again, 2))
    repeated, _ = load_ensemble(again)
    for name, value in method.state_dict().items():
        assert torch.equal(value, repeated.state_dict()[name]), name
    models = next(iter(method.parameters()))
    assert not torch.equal(models[0], models[1])


def test_parts_of_an_ensemble_are_joined_in_their_order(rollouts, tmp_path):
    parts = {}
    for k in range(2):
        told = settings(steps=20)
        told["training"] |= {"seed": 5 + k, "models": 1 + k}
        parts[f"part/{k}"] = tmp_path / str(k)
        parts[f"part/{k}"].mkdir()
        train.produce(Run(told, {"rollouts": rollouts}, parts[f"part/{k}"], 1))
    out = tmp_path / "out"
    out.mkdir()
    train.produce(Run(settings(steps=20), parts, out, 1))
    joined, standardiser = load_ensemble(out)
    state, action, outcome = (torch.randn(3, 4, 8, size) for size in (2, 1, 2))
    found = joined.sequence_predictions(state, action, outcome)
    first = 0
    for part in parts.values():
        own, same = load_ensemble(part)
        of = slice(first, first + own.models)
        expected = own.sequence_predictions(state[of], action[of], outcome[of])
        torch.testing.assert_close(found[of], expected)
        assert torch.equal(same.restore("outcome", outcome), standardiser.restore("outcome", outcome))
        first = of.stop
    losses = pd.read_csv(out / "losses.csv")
    second = pd.read_csv(tmp_path / "1" / "losses.csv")
    assert set(losses["model"]) == {0, 1, 2}
    np.testing.assert_allclose(losses.query("model == 2")["train"], second.query("model == 1")["train"])
    assert (out / "device.json").is_file()


def test_evaluation_adapts(trained, rollouts, tmp_path):
    config = {
        "method": "kalman",
        "seed": 0,
        "repeats": 2,
        "samples": 12,
        "queries": 12,
        "noise_variances": [0.0, 0.1],
    }
    evaluate.produce(Run(config, {"train": trained, "rollouts": rollouts}, tmp_path, 1))
    errors = pd.read_parquet(tmp_path / "errors.parquet")
    assert len(errors) == 2 * 12 * 13 * 2 * 2
    mean = errors.groupby(["noise_variance", "samples"])["error_m"].mean()
    assert mean[0.0, 12] < 0.5 * mean[0.0, 0]
    assert mean[0.1, 12] < 0.7 * mean[0.1, 0]
    assert errors.query("noise_variance == 0.1")["noise_sd_m"].min() > 0
