"""Recordings as data for adaptation methods: one task for each object of each rig."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.config.sources import RecordedTasksSettings
from slapshot.errors import InputError
from slapshot.recordings.format import Recording
from slapshot.recordings.read import read_recording, recording_folders
from slapshot.trajectories.vae import TrajectoryVae

# rad: commands that the trajectory model reproduces less well have no latent vector.
MAX_ENCODING_ERROR = 0.05


@dataclass(frozen=True)
class RecordedTask:
    """Hits of one object on one rig whose rest point the camera saw.

    Attributes:
        recording: name in the configuration.
        rig: number of the stand-in rig, 0 for a user's own recording.
        object: object_id.
        stand_in: True for a stand-in rig, which is no real robot.
        hits: (n) rows of the table of hits.
        data: state, action and outcome (n, size) in the units of the rollouts.
        where: name of the task in messages.
    """

    recording: str
    rig: int
    object: str
    stand_in: bool
    hits: pd.DataFrame
    data: dict[str, NDArray[np.float32]]
    where: str

    def take(self, rows: NDArray[np.int64]) -> dict[str, NDArray[np.float32]]:
        """State, action and outcome of some hits as one task, (1, rows, size)."""
        return {name: values[rows][None] for name, values in self.data.items()}


def recorded_tasks(settings: RecordedTasksSettings, inputs: Mapping[str, Path]) -> Iterator[RecordedTask]:
    """All tasks in the recordings that a stage reads.

    Args:
        settings: of the stage.
        inputs: folders of trajectory_model and of the stand-in rigs, with the roles of `recording_folders`.

    Raises:
        InputError: a recording cannot be read, or its hits have no latents of the trajectory model.
    """
    model = TrajectoryVae.load(inputs["trajectory_model"])
    folders = recording_folders(settings.recordings, inputs)
    for (name, rig), folder in folders.items():
        recording = read_recording(folder)
        latents = hit_latents(recording, model, settings.trajectory_model_id, folder)
        yield from _tasks(name, rig, folder, recording, latents)


def _tasks(
    name: str, rig: int, folder: Path, recording: Recording, latents: NDArray[np.float32]
) -> Iterator[RecordedTask]:
    for object_id in recording.objects:
        seen = (recording.hits["object_id"] == object_id) & recording.hits["rest_x"].notna()
        hits = recording.hits[seen].reset_index(drop=True)
        if len(hits):
            data = {
                "state": hits[["start_x", "start_y"]].to_numpy(np.float32),
                "action": latents[seen.to_numpy()],
                "outcome": hits[["rest_x", "rest_y"]].to_numpy(np.float32),
            }
            where = f"{folder}: object {object_id}"
            yield RecordedTask(name, rig, object_id, recording.stand_in, hits, data, where)


def hit_latents(
    recording: Recording, model: TrajectoryVae, model_id: str, folder: Path
) -> NDArray[np.float32]:
    """Latents (hits, latent): as recorded if they are of this model, else encoded from the commands.

    Raises:
        InputError: neither is possible.
    """
    hits = recording.hits
    if recording.trajectory_model == model_id and hits["latent"].notna().all():
        return np.stack(hits["latent"].to_list()).astype(np.float32)
    if recording.commands is None:
        raise InputError(
            f"{folder}: its latents belong to trajectory model {recording.trajectory_model}, not to "
            f"{model_id}, and there is no commands.parquet to encode; add the commands"
        )
    times = np.linspace(0, model.sizes.duration, model.sizes.waypoints)
    columns = [f"q{i}" for i in range(model.sizes.joints)]
    groups = dict(tuple(recording.commands.groupby("hit")))
    waypoints = []
    for hit in hits["hit"]:
        if hit not in groups:
            raise InputError(f"{folder}/commands.parquet: no commands for hit {hit}; add them")
        commands = groups[hit]
        waypoints.append(np.stack([np.interp(times, commands["t"], commands[c]) for c in columns], axis=1))
    stacked = np.stack(waypoints)
    latents = model.latents(stacked)
    error = np.sqrt(((model.waypoints(latents) - stacked) ** 2).mean((1, 2)))
    worst = int(error.argmax())
    if error[worst] > MAX_ENCODING_ERROR:
        raise InputError(
            f"{folder}/commands.parquet: the commands of hit {hits['hit'].iloc[worst]} are "
            f"{error[worst]:.3f} rad from anything that trajectory model {model_id} can do; train it "
            "on demonstrations like them"
        )
    return latents.astype(np.float32)


def split_hits(
    hits: pd.DataFrame, samples: int, repeats: int, rng: np.random.Generator, where: str
) -> tuple[list[NDArray[np.int64]], list[NDArray[np.int64]]]:
    """Row numbers to adapt to (`samples` of them) and to score on (the rest), without a common command.

    Raises:
        InputError: too few hits.
    """
    own = hits["command_id"].astype("Float64").to_numpy(float, na_value=np.nan)
    # A hit without a command id counts as a command of its own.
    commands = np.where(np.isnan(own), -1 - np.arange(len(hits)), own)
    unique = np.unique(commands)
    adapt, query = [], []
    for _ in range(repeats):
        rank = pd.Series(rng.permutation(len(unique)), index=unique)[commands].to_numpy()
        order = np.lexsort((rng.random(len(hits)), rank))
        chosen = order[:samples]
        others = np.flatnonzero(~np.isin(commands, commands[chosen]))
        if len(chosen) < samples or len(others) == 0:
            raise InputError(
                f"{where}: {len(hits)} hits with a rest point are too few for {samples} samples and "
                "some hits to score on; record more, or lower recordings.samples"
            )
        adapt.append(rng.permutation(chosen))
        query.append(others)
    return adapt, query
