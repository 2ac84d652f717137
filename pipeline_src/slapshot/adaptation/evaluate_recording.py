"""Stage `evaluate_recording`: error against samples on a recording, real or stand-in."""

import logging
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from slapshot.adaptation.checkpoint import load_ensemble
from slapshot.adaptation.evaluate import error_table
from slapshot.adaptation.scoring import errors_against_samples
from slapshot.command import Run, stage_command
from slapshot.errors import InputError
from slapshot.recordings.format import Recording
from slapshot.recordings.read import read_recording
from slapshot.trajectories.vae import TrajectoryVae

log = logging.getLogger("slapshot")

# rad: commands that the trajectory model cannot reproduce are no samples of its latent space.
MAX_ENCODING_ERROR = 0.05


def produce(run: Run) -> None:
    """Write errors.parquet: method, model, object, repeat, samples, error_m, stand_in.

    Each repeat splits an object's commands at random: hits of some commands to adapt to, in random
    order, hits of the other commands to score on.
    """
    settings = run.config
    torch.set_num_threads(run.cores)
    method, standardiser = load_ensemble(run.inputs["train"])
    model = TrajectoryVae.load(run.inputs["trajectory_model"])
    path = run.inputs.get("lab")
    folder = path / "recording" if path is not None else Path(settings["path"])
    recording = read_recording(folder)
    latents = hit_latents(recording, model, settings["trajectory_model_id"], folder)
    rng = np.random.default_rng(settings["seed"])
    tables = []
    for object_id in recording.objects:
        seen = (recording.hits["object_id"] == object_id) & recording.hits["rest_x"].notna()
        hits = recording.hits[seen]
        if len(hits) == 0:
            continue
        state = hits[["start_x", "start_y"]].to_numpy(np.float32)
        outcome = hits[["rest_x", "rest_y"]].to_numpy(np.float32)
        data = {"state": state, "action": latents[seen.to_numpy()], "outcome": outcome}
        adapt, query = split_hits(
            hits, settings["samples"], settings["repeats"], rng, f"{folder}: object {object_id}"
        )
        for repeat in range(settings["repeats"]):
            errors = errors_against_samples(
                method,
                standardiser,
                {name: values[adapt[repeat]][None] for name, values in data.items()},
                {name: values[query[repeat]][None] for name, values in data.items()},
            )
            task = pd.DataFrame({"object": [object_id], "repeat": [repeat]})
            tables.append(error_table(errors, task))
    table = pd.concat(tables, ignore_index=True)
    table = table.assign(method=settings["method"], stand_in=recording.stand_in)
    table.to_parquet(run.out / "errors.parquet", index=False)
    means = table.groupby("samples")["error_m"].mean()
    log.info("%.1f cm before, %.1f cm after %d samples", 100 * means.iloc[0],
             100 * means.iloc[-1], means.index[-1])  # fmt: skip


def hit_latents(
    recording: Recording, model: TrajectoryVae, model_id: str, folder: Path
) -> NDArray[np.float32]:
    """(hits, latent): as recorded if they are this model's, else encoded from the commands.

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
    """Row numbers to adapt to (samples) and to score on (the rest), no command in both.

    Raises:
        InputError: too few hits.
    """
    own = hits["command_id"].astype("Float64").to_numpy(float, na_value=np.nan)
    # Without a command id, a hit is a command of its own.
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


if __name__ == "__main__":
    stage_command("evaluate_recording", produce)
