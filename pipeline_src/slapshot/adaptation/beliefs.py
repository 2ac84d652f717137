"""Stage `beliefs`: hidden states of test conditions and recordings, and the NIS of each sample."""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.method import AdaptationMethod
from slapshot.adaptation.recorded import recorded_tasks, split_hits
from slapshot.command import Run, stage_command
from slapshot.config.methods import BeliefsSettings
from slapshot.parquet import write_table
from slapshot.rollouts.reading import read_sequences

log = logging.getLogger("slapshot")

Arrays = dict[str, NDArray[np.float32]]
_NAMES = ("state", "action", "outcome")


def produce(run: Run) -> None:
    """Write latents.parquet and, for a method that computes innovations, innovations.parquet.

    latents: source (simulated, recorded), recording, rig, object, condition, name, friction_x, friction_y,
    noise_variance, repeat, model, samples, hidden (list). innovations: the same keys, then samples (seen
    before this one), nis (normalised innovation squared), x_m, y_m (rest point of the hit). noise_variance
    is NaN where it was drawn as in training.
    """
    settings = run.settings(BeliefsSettings)
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    rng = np.random.default_rng(settings.seed)
    latents, innovations = [], []
    for keys, sequences in [
        *_simulated(settings, run.inputs["rollouts"], standardiser, rng),
        *_recorded(settings, run.inputs, rng),
    ]:
        hidden, surprise = _adapt(method, standardiser, sequences, settings.samples)
        latents.append(_table(keys, hidden, "hidden", settings.samples))
        if surprise is not None:
            table = _table(keys, surprise, "nis", range(surprise.shape[2]))
            ends = np.broadcast_to(sequences["outcome"], (method.models, *sequences["outcome"].shape))
            innovations.append(table.assign(x_m=ends[..., 0].ravel(), y_m=ends[..., 1].ravel()))
    _write(pd.concat(latents, ignore_index=True), run.out / "latents.parquet")
    if innovations:
        write_table(pd.concat(innovations, ignore_index=True), run.out / "innovations.parquet")
    log.info("%d hidden states", sum(map(len, latents)))


def _simulated(
    settings: BeliefsSettings, rollouts: Path, standardiser: Standardiser, rng: np.random.Generator
) -> Iterator[tuple[pd.DataFrame, Arrays]]:
    """Test conditions at each noise level and with the noise of training, `repeats` times each."""
    data = read_sequences(rollouts, "test")
    count, hits, size = data.outcome.shape
    most = max(settings.samples)
    scale = standardiser.scale["outcome"].numpy()
    columns = ["condition", "name", "friction_x", "friction_y"]
    for repeat in range(settings.repeats):
        order = rng.permuted(np.tile(np.arange(hits), (count, 1)), axis=1)[:, :most, None]
        taken = {name: np.take_along_axis(getattr(data, name), order, 1) for name in _NAMES}
        white = rng.normal(size=taken["outcome"].shape)
        drawn = rng.uniform(0, settings.noise_variance_max, (count, 1, size))
        for variance in (np.nan, *settings.noise_variances):
            sd = np.sqrt(drawn if np.isnan(variance) else variance) * scale
            keys = data.conditions[columns].assign(
                source="simulated", recording="", rig=-1, object="", repeat=repeat, noise_variance=variance
            )
            noisy = (taken["outcome"] + sd * white).astype(np.float32)
            yield keys, taken | {"outcome": noisy}


def _recorded(
    settings: BeliefsSettings, inputs: Mapping[str, Path], rng: np.random.Generator
) -> Iterator[tuple[pd.DataFrame, Arrays]]:
    """Hits of each object of each recorded rig, in `repeats` random orders."""
    for task in recorded_tasks(settings, inputs):
        chosen, _ = split_hits(task.hits, max(settings.samples), settings.repeats, rng, task.where)
        parts = [task.take(rows) for rows in chosen]
        keys = pd.DataFrame({"repeat": range(settings.repeats)}).assign(
            source="recorded", recording=task.recording, rig=task.rig, object=task.object,
            condition=-1, name="", friction_x=np.nan, friction_y=np.nan, noise_variance=np.nan,
        )  # fmt: skip
        yield keys, {name: np.concatenate([part[name] for part in parts]) for name in _NAMES}


@torch.no_grad()
def _adapt(
    method: AdaptationMethod[Any], standardiser: Standardiser, sequences: Arrays, samples: list[int]
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Hidden states (M, B, samples, h), and the NIS (M, B, N, 1) of every sample if the method has one."""

    def tensor(name: str) -> Tensor:
        standardised = standardiser.standardise(name, sequences[name])
        return standardised.expand(method.models, *standardised.shape)

    data = [tensor(name) for name in _NAMES]
    beliefs = method.adapt(*data)
    hidden = torch.stack([method.hidden(beliefs[n]) for n in samples], dim=2).numpy()
    surprise = getattr(method, "normalised_innovation_squared", None)
    if surprise is None:
        return hidden, None
    found = [surprise(beliefs[i], *(x[:, :, i] for x in data)) for i in range(data[0].shape[2])]
    return hidden, torch.stack(found, dim=2)[..., None].numpy()


def _table(keys: pd.DataFrame, values: NDArray[np.float32], name: str, samples: Any) -> pd.DataFrame:
    """Long table of values (M, B, samples, size) with the keys (B) of the tasks."""
    models, tasks, _, size = values.shape
    index = pd.MultiIndex.from_product(
        [range(models), range(tasks), samples], names=["model", "task", "samples"]
    )
    flat = values.reshape(-1, size)
    table = pd.DataFrame({name: list(flat) if name == "hidden" else flat[:, 0]}, index=index).reset_index()
    return table.join(keys.reset_index(drop=True), on="task").drop(columns="task")


def _write(table: pd.DataFrame, path: Path) -> None:
    """Write hidden states as lists of fixed size: half the space, and NumPy reads them without a copy."""
    flat = pa.array(np.concatenate(table["hidden"].to_list()).astype(np.float32))
    hidden = pa.FixedSizeListArray.from_arrays(flat, len(table["hidden"].iloc[0]))
    rest = pa.Table.from_pandas(table.drop(columns="hidden"), preserve_index=False)
    write_table(rest.append_column("hidden", hidden), path)


if __name__ == "__main__":
    stage_command("beliefs", produce)
