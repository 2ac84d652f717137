"""Stage `acting`: hits at targets on a rig, chosen by models that adapted to earlier hits on it."""

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from slapshot.adaptation.recorded import RecordedTask, recorded_tasks
from slapshot.arrays import Array
from slapshot.command import Run, stage_command
from slapshot.config.acting import ActingSettings
from slapshot.goal_reaching.action_optimizer import BelievingChooser, Chooser
from slapshot.goal_reaching.ensemble import load_acting, load_believing
from slapshot.goal_reaching.goals import goals_of
from slapshot.goal_reaching.inverse import load_inverse
from slapshot.goal_reaching.rigs import Robot, robot_of, sampled_hits
from slapshot.parquet import write_table

log = logging.getLogger("slapshot")

ORACLE = "oracle"


def produce(run: Run) -> None:
    """Write acting.parquet: rig, object, method, chooser, samples, target, target_x_m, target_y_m, error_m.

    Every method adapts to the same hits with sampled latents. error_m is the distance between the target and
    the observed rest point. Targets are the noiseless rest points of recorded commands, so that they can be
    reached; the oracle repeats that command, and its error is the scatter from hit to hit (its `samples` are
    -1, its method is empty).

    Raises:
        InputError: the method has no belief from which to compute uncertainty.
    """
    settings = run.settings(ActingSettings)
    torch.set_num_threads(run.cores)
    robot = robot_of(settings, run.inputs, run.cores)
    rng = np.random.default_rng([settings.seed, settings.rig, 1])
    choosers = _choosers(settings, run.inputs, robot.candidates(settings.candidates, rng))
    parts = [_act(choosers, robot, task, settings, rng) for task in recorded_tasks(settings, run.inputs)]
    table = pd.concat(parts, ignore_index=True).assign(rig=settings.rig)
    write_table(table, run.out / "acting.parquet")
    last = table[table["samples"].isin([-1, max(settings.samples)])]
    who = (last["method"] + " " + last["chooser"]).str.strip()
    means = 100 * last.groupby(who)["error_m"].mean()
    log.info("%s", ", ".join(f"{name} {error:.1f} cm" for name, error in means.items()))


def _choosers(settings: ActingSettings, inputs: Mapping[str, Path], candidates: Array) -> dict[str, Chooser]:
    """Method -> its optimiser of latents."""
    believing, standardiser = load_believing(inputs[f"train/{settings.method}"])
    inverse = load_inverse(inputs["inverse"], believing, settings.inverse.hidden)
    generator = torch.Generator().manual_seed(settings.seed)
    choosers: dict[str, Chooser] = {
        settings.method: BelievingChooser(
            believing, standardiser, candidates, inverse, settings.draws, generator
        )
    }
    for name in settings.compared:
        choosers[name] = Chooser(*load_acting(inputs[f"train/{name}"]), candidates)
    return choosers


def _act(
    choosers: Mapping[str, Chooser],
    robot: Robot,
    task: RecordedTask,
    settings: ActingSettings,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Hits at the targets of one object."""
    goals = goals_of(robot, task, settings.targets, [settings.seed, settings.rig])
    start = task.data["state"][0].copy()  # tables are read-only, tensors are not
    seen = sampled_hits(robot, task, max(settings.samples), rng)
    chosen = {("", ORACLE, -1): goals.latents}
    for method, chooser in choosers.items():
        beliefs = chooser.beliefs(seen)
        for samples in settings.samples:
            found = chooser.latents(beliefs[samples], start, goals.targets)
            chosen |= {(method, name, samples): latents for name, latents in found.items()}
    rows = [(*key, i, *target) for key in chosen for i, target in enumerate(goals.targets)]
    columns = ["method", "chooser", "samples", "target", "target_x_m", "target_y_m"]
    table = pd.DataFrame(rows, columns=columns).assign(object=task.object)
    rests = robot.hit(np.concatenate(list(chosen.values())), table["object"].tolist(), rng)
    off = rests - table[["target_x_m", "target_y_m"]].to_numpy()
    return table.assign(error_m=np.linalg.norm(off, axis=1))


if __name__ == "__main__":
    stage_command("acting", produce)
