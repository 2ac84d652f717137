"""A made-up world with all that the stages after training read, small enough to be made for the tests.

A hit comes to rest at 0.3 m * action / friction, along x and along y: two parameters to find from hits.
"""

import copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from slapshot.adaptation import train
from slapshot.adaptation.checkpoint import save_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.lstm import Lstm
from slapshot.adaptation.method import Sizes
from slapshot.config.methods import LstmSettings
from slapshot.recordings.format import ObjectInfo, Recording
from slapshot.recordings.write import write_recording
from slapshot.rollouts.reading import read_sequences
from slapshot.trajectories.vae import TrajectoryVae, VaeSizes

HITS = 24  # of a condition, and of an object of a rig
SPLITS = {"train": 200, "validation": 40, "test": 22}
NAMED = ("low friction", "medium friction")  # the last of the test conditions
NOISE_VARIANCE_MAX = 0.2
MODEL_ID = "0123456789ab"


class World(NamedTuple):
    """Folders that stages read, and a configuration for what reads recordings."""

    rollouts: Path
    kalman: Path
    lstm: Path
    rigs: tuple[Path, Path]
    trajectory_model: Path

    def inputs(self, method: str = "kalman", **more: Path) -> dict[str, Path]:
        rigs = {f"lab/lab/{i}": folder for i, folder in enumerate(self.rigs)}
        return {
            "train": getattr(self, method),
            "rollouts": self.rollouts,
            "trajectory_model": self.trajectory_model,
            **rigs,
            **more,
        }

    def config(self, method: str = "kalman", **more: Any) -> dict[str, Any]:
        recordings = {"lab": {"rigs": len(self.rigs)}}
        common = {"method": method, "seed": 5, "trajectory_model_id": MODEL_ID, "recordings": recordings}
        return {**common, **more}

    def hits(self, rig: int) -> pd.DataFrame:
        return pd.read_parquet(self.rigs[rig] / "recording" / "hits.parquet")


@pytest.fixture(autouse=True)
def threads():
    """Stages set how many threads torch uses; every test leaves it as it was."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def world(tmp_path_factory) -> World:
    root = tmp_path_factory.mktemp("world")
    names = ("rollouts", "kalman", "lstm", "trajectory_model", "rig0", "rig1")
    rollouts, kalman, lstm, trajectory_model, *rigs = (root / name for name in names)
    for folder in (rollouts, kalman, lstm, trajectory_model, *rigs):
        folder.mkdir()
    write_rollouts(rollouts, seed=0)
    for seed, folder in enumerate(rigs):
        write_recording(draw_recording(seed), folder / "recording")
    TrajectoryVae(VaeSizes(3, 2, 2, (), 0.8)).save(trajectory_model)
    threads = torch.get_num_threads()
    train_kalman(rollouts, kalman)
    torch.set_num_threads(threads)
    # Not trained: what is tested with it does not depend on how good it is.
    settings = LstmSettings(state=6, hidden=(8,))
    g = torch.Generator().manual_seed(2)
    method = Lstm(Sizes(2, 2, 2), settings, 2, g)
    save_ensemble(lstm, "lstm", method, Standardiser.fit(read_sequences(rollouts, "train")))
    return World(rollouts, kalman, lstm, (rigs[0], rigs[1]), trajectory_model)


def train_kalman(rollouts: Path, out: Path) -> None:
    training = {
        "seed": 1, "models": 2, "steps": 300, "tasks": 24, "sequence": 12, "learning_rate": 1e-2,
        "noise_variance_max": NOISE_VARIANCE_MAX,
    }  # fmt: skip
    settings = {"latent": 3, "hidden": [32], "drift": 1e-4}
    config = {"method": "kalman", "settings": settings, "training": training}
    train.produce(train.Run(config, {"rollouts": rollouts}, out, 1))


def rest(action: np.ndarray, friction: np.ndarray) -> np.ndarray:
    return (0.3 * action / friction).astype(np.float32)


def write_rollouts(folder: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    conditions = []
    for split, count in SPLITS.items():
        friction = np.exp(rng.uniform(-1, 1, (count, 2)))
        name = np.full(count, "", dtype=object)
        if split == "test":
            friction[-2:], name[-2:] = [[0.4, 0.4], [1.0, 1.0]], NAMED
        action = rng.normal(size=(count, HITS, 2)).astype(np.float32)
        columns = {
            "state": np.zeros((count, HITS, 2), np.float32),
            "action": action,
            "outcome": rest(action, friction[:, None]),
        }
        arrays = {k: pa.FixedSizeListArray.from_arrays(pa.array(v.ravel()), 2) for k, v in columns.items()}
        pq.write_table(pa.table(arrays), folder / f"hits-{split}.parquet")
        conditions.append(
            pd.DataFrame({"split": split, "condition": range(count), "name": name,
                          "friction_x": friction[:, 0], "friction_y": friction[:, 1]})
        )  # fmt: skip
    pd.concat(conditions).to_parquet(folder / "conditions.parquet", index=False)
    tracks(rng).to_parquet(folder / "tracks.parquet", index=False, row_group_size=50)


def tracks(rng: np.random.Generator) -> pd.DataFrame:
    """Three rows for each of: two hits of a training condition, three of most test conditions, all of one."""
    kept = [("train", 0, hit) for hit in (1, 2)]
    for condition in range(SPLITS["test"]):
        hits = range(HITS) if condition == 3 else rng.choice(HITS, 3, replace=False)
        kept += [("test", condition, hit) for hit in sorted(hits)]
    table = pd.DataFrame(kept, columns=["split", "condition", "hit"])
    return table.loc[table.index.repeat(3)].assign(t=0.0, x=0.0, y=0.0, yaw=0.0)


def draw_recording(seed: int) -> Recording:
    """Two pucks in turns, HITS hits each; commands of three repeats each, and some without a number."""
    rng = np.random.default_rng([seed, 1])
    count = 2 * HITS
    pair = np.arange(count) // 2  # both pucks get the same commands
    command = pd.array(np.where(pair < 15, pair // 3, 100 + pair), dtype="Int64")
    command[pair >= 20] = pd.NA
    latent = rng.normal(size=(count, 2))
    for number in range(5):  # a command is one action
        latent[(command == number).fillna(False)] = rng.normal(size=2)
    puck = np.where(np.arange(count) % 2 == 0, "red", "blue")
    friction = np.where((puck == "red")[:, None], [0.45, 0.5], [2.0, 1.8]) * np.exp(rng.normal(0, 0.1, 2))
    ends = rest(latent, friction) + rng.normal(0, 0.03, (count, 2))
    hits = pd.DataFrame(
        {"hit": np.arange(count), "object_id": puck, "order": np.arange(count), "recorded_at": pd.NaT,
         "command_id": command, "start_x": 0.0, "start_y": 0.0, "rest_x": ends[:, 0], "rest_y": ends[:, 1],
         "latent": list(latent)}
    )  # fmt: skip
    hits.loc[4, ["rest_x", "rest_y"]] = np.nan  # one that the camera lost
    info = ObjectInfo(shape="cylinder", size_m=(0.076, 0.025), mass_kg=0.1, mass_sd_kg=0.001)
    return Recording(
        rig=f"made-up {seed}", objects={"red": info, "blue": copy.copy(info)}, camera_rate_hz=30.0,
        frame_note="made up", stand_in=True, trajectory_model=MODEL_ID, note="", sealed_truth_sha256=None,
        hits=hits, tracks=None, commands=None, joints=None,
    )  # fmt: skip


class Calls(NamedTuple):
    """What a stage asked of its method, in the units of the data: model 0 of (M, B, N, size)."""

    adapted: list[dict[str, np.ndarray]]  # state, action, observed
    predicted: list[dict[str, np.ndarray]]  # state, action, outcome


@pytest.fixture
def spy(monkeypatch) -> Any:
    """Makes a stage's module load methods whose calls are written down."""

    def watch(module: Any) -> Calls:
        calls, original = Calls([], []), module.load_ensemble

        def load(folder: Path) -> Any:
            method, standardiser = original(folder)
            adapt, predict = method.adapt, method.predict

            def noted(**values: torch.Tensor) -> dict[str, np.ndarray]:
                named = {"observed": "outcome"}
                return {
                    name: standardiser.restore(named.get(name, name), value)[0].detach().numpy()
                    for name, value in values.items()
                }

            def noting_adapt(state, action, observed):
                calls.adapted.append(noted(state=state, action=action, observed=observed))
                return adapt(state, action, observed)

            def noting_predict(belief, state, action):
                outcome = predict(belief, state, action)
                calls.predicted.append(noted(state=state, action=action, outcome=outcome))
                return outcome

            method.adapt, method.predict = noting_adapt, noting_predict
            return method, standardiser

        monkeypatch.setattr(module, "load_ensemble", load)
        return calls

    return watch
