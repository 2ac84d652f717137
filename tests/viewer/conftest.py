"""A version of the stage `viewer`, made from fabricated upstream versions."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recordings.builder import make_recording
from rerun.chunk import RrdReader
from slapshot.command import Run
from slapshot.recordings.format import Recording
from slapshot.recordings.write import write_recording
from slapshot.viewer.__main__ import produce
from slapshot.viewer.hit_recording import read_index

CONFIG = {"simulated": 3, "recorded": 4, "domain": "hockey", "recordings": {"lab": {"rigs": 1}}}
SAMPLES = (0, 1, 2, 8)
HITS = 4  # of each condition


class Made(NamedTuple):
    """The version's folder and what it was made from."""

    folder: Path
    inputs: dict[str, Path]
    predictions: pd.DataFrame
    recording: Recording

    @property
    def hits(self) -> list[dict]:
        return read_index(self.folder)["hits"]

    def hit(self, source: str) -> dict:
        return next(hit for hit in self.hits if hit["source"] == source)

    def beliefs(self, hit: dict) -> pd.DataFrame:
        keys = ["source", "condition", "rig", "object", "hit"]
        rows = self.predictions[(self.predictions[keys] == [hit[k] for k in keys]).all(axis=1)]
        return rows.sort_values("samples")


@pytest.fixture(scope="session")
def inputs(rig, tmp_path_factory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("viewer-inputs")
    recording = make_recording()
    write_recording(recording, root / "lab" / "recording")
    _write_rollouts(root / "rollouts", len(rig.swings.latents))
    (root / "predictions").mkdir()
    _predictions(root / "rollouts", recording).to_parquet(root / "predictions/predictions.parquet")
    return {
        "scene": rig.folders["scene"],
        "swings": rig.folders["swings"],
        "rollouts": root / "rollouts",
        "predictions": root / "predictions",
        "lab/lab/0": root / "lab",
    }


@pytest.fixture(scope="session")
def made(inputs, tmp_path_factory) -> Made:
    folder = tmp_path_factory.mktemp("viewer")
    produce(Run(CONFIG, inputs, folder, 1))
    predictions = pd.read_parquet(inputs["predictions"] / "predictions.parquet")
    return Made(folder, inputs, predictions, make_recording())


def read(file: Path, index: str | None) -> pd.DataFrame:
    """A recording's rows on a timeline; with None, what is static."""
    table = RrdReader(file).stream().collect().reader(index=index).to_pandas()
    if index is not None and pd.api.types.is_timedelta64_dtype(table[index]):
        table[index] = table[index].dt.total_seconds()
    return table


def values(table: pd.DataFrame, column: str) -> list[np.ndarray]:
    """Rows of a column that are not null, as float arrays."""
    return [_array(value) for value in table[column] if value is not None]


def _array(value) -> np.ndarray:  # Rerun's lists come as arrays of arrays
    nested = isinstance(value, np.ndarray) and value.dtype == object
    return np.stack([_array(v) for v in value]) if nested else np.asarray(value, float)


def _write_rollouts(folder: Path, swings: int) -> None:
    folder.mkdir()
    rng = np.random.default_rng(1)
    keys = [(c, h) for c in range(2) for h in range(HITS)]
    tracks = []
    for condition, hit in keys:
        t = np.arange(40) * 0.02
        slid = np.clip((t - 0.5) / 0.2, 0, 1)[:, None] * rng.uniform(-1, 1, 2)
        columns = {"t": t, "x": 0.55 + slid[:, 0], "y": slid[:, 1], "yaw": slid[:, 0]}
        tracks.append(pd.DataFrame({"split": "test", "condition": condition, "hit": hit, **columns}))
    foreign = tracks[0].assign(split="train", x=9.0)
    table = pd.concat([foreign, *tracks]).astype(dict.fromkeys(("t", "x", "y", "yaw"), "float32"))
    table.to_parquet(folder / "tracks.parquet", index=False)
    hits = pd.DataFrame(keys, columns=["condition", "hit"]).assign(swing=rng.integers(0, swings, len(keys)))
    pq.write_table(pa.Table.from_pandas(hits), folder / "hits-test.parquet")


def _predictions(rollouts: Path, recording: Recording) -> pd.DataFrame:
    tracks = pd.read_parquet(rollouts / "tracks.parquet")
    ends = tracks[tracks["split"] == "test"].groupby(["condition", "hit"])[["x", "y"]].last().reset_index()
    seen = recording.hits[recording.hits["rest_x"].notna()]
    truths = pd.concat(
        [
            ends.rename(columns={"x": "true_x_m", "y": "true_y_m"}).assign(
                source="simulated",
                recording="",
                rig=-1,
                object="",
                name=np.array(["", "icy"])[ends["condition"]],
            ),
            seen[["hit", "object_id", "rest_x", "rest_y"]]
            .set_axis(["hit", "object", "true_x_m", "true_y_m"], axis=1)
            .assign(source="recorded", recording="lab", rig=0, condition=-1, name=""),
        ]
    )
    rng = np.random.default_rng(2)
    tables = []
    for samples in SAMPLES:
        root = rng.normal(size=(len(truths), 2, 2)) * 0.1 / np.sqrt(1 + samples)
        covariance = root @ root.transpose(0, 2, 1) + 1e-4 * np.eye(2)
        off = np.einsum("nij,nj->ni", root, rng.normal(size=(len(truths), 2)))
        tables.append(
            truths.assign(
                samples=samples,
                model=0,
                x_m=truths["true_x_m"] + off[:, 0],
                y_m=truths["true_y_m"] + off[:, 1],
                cov_xx=covariance[:, 0, 0],
                cov_xy=covariance[:, 0, 1],
                cov_yy=covariance[:, 1, 1],
                radius2_50=1.4 + 0.01 * samples,
                radius2_90=4.9 + 0.01 * samples,
            )
        )
    return pd.concat(tables, ignore_index=True).sample(frac=1, random_state=3, ignore_index=True)
