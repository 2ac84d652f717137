"""Stage `acting`: hits at targets on a rig, chosen by models that adapted to it."""

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.acting.choose import LARGEST_LATENT, cheapest, choose_by_gradient, draw_phi, expected_cost
from slapshot.acting.ensemble import load_believing
from slapshot.acting.inverse import InverseModel, Standardisation, load_inverse
from slapshot.acting.rigs import Robot, batched
from slapshot.adaptation.data import Standardiser
from slapshot.adaptation.kalman import Kalman, KalmanBelief
from slapshot.adaptation.recorded import RecordedTask, recorded_tasks, split_hits
from slapshot.command import Run, stage_command
from slapshot.lab.live import LiveRig
from slapshot.scenes.domain import load_part
from slapshot.scenes.scene import Scene
from slapshot.trajectories.vae import TrajectoryVae

log = logging.getLogger("slapshot")

Array = NDArray[np.float64]
ORACLE = "oracle"
GRADIENT, MEAN_ONLY, INVERSE = "gradient", "gradient, means only", "inverse model"


def produce(run: Run) -> None:
    """Write acting.parquet: rig, object, chooser, samples, target, target_x_m, target_y_m, error_m.

    error_m is the distance from the target at which the object was seen to rest. Targets are where recorded
    commands, whose hits were not adapted to, lead without chance, so that they can be reached; the oracle
    repeats that command, and misses by what differs from hit to hit (its `samples` are -1).

    Raises:
        InputError: the method has no belief that uncertainty could be taken from.
    """
    settings = run.config
    torch.set_num_threads(run.cores)
    method, standardiser = load_believing(run.inputs["train"])
    inverse = load_inverse(run.inputs["inverse"], method, settings["inverse"]["hidden"])
    chooser = Chooser(method, standardiser, inverse, settings["draws"], settings["seed"])
    robot = _robot(run)
    rng = np.random.default_rng([settings["seed"], settings["rig"], 1])
    candidates = robot.candidates(settings["candidates"], rng)
    plans = [_plan(chooser, robot, task, candidates, settings, rng) for task in recorded_tasks(run)]
    table = pd.concat([rows for rows, _ in plans], ignore_index=True)
    latents = np.concatenate([chosen for _, chosen in plans])
    rests = robot.hit(latents, table["object"].tolist(), rng)
    off = rests - table[["target_x_m", "target_y_m"]].to_numpy()
    table = table.assign(rig=settings["rig"], error_m=np.linalg.norm(off, axis=1))
    table.to_parquet(run.out / "acting.parquet", index=False)
    last = table[table["samples"].isin([-1, max(settings["samples"])])]
    means = 100 * last.groupby("chooser")["error_m"].mean()
    log.info("%s", ", ".join(f"{name} {error:.1f} cm" for name, error in means.items()))


def _robot(run: Run) -> Robot:
    settings = run.config
    scene = Scene.load(run.inputs["scene"])
    rig = LiveRig(scene, settings["lab"], [settings["seed"], settings["rig"]], run.cores)
    check = load_part(settings["domain"], "safety").SafetyCheck(scene)
    return Robot(rig, TrajectoryVae.load(run.inputs["trajectory_model"]), check)


class Chooser:
    """An ensemble that acts as one."""

    def __init__(
        self,
        method: Kalman,
        standardiser: Standardiser,
        inverse: InverseModel,
        draws: int,
        seed: int,
    ) -> None:
        self._method, self._standardiser, self._inverse = method, standardiser, inverse
        self._draws, self._generator = draws, torch.Generator().manual_seed(seed)
        self._to_action = Standardisation(standardiser.mean["action"], standardiser.scale["action"])

    def beliefs(self, task: RecordedTask, rows: NDArray[np.int64]) -> list[KalmanBelief]:
        """After 0, 1, ... of the hits in `rows`."""
        taken = task.take(rows)
        with torch.no_grad():
            return self._method.adapt(
                *(
                    batched(self._standardiser.standardise(name, taken[name]), self._method.models)
                    for name in ("state", "action", "outcome")
                )
            )

    def latents(
        self, belief: KalmanBelief, start: NDArray[np.floating], candidates: Array, targets: Array
    ) -> dict[str, Array]:
        """Chooser -> latents (T, latent) for targets (T, 2) m, given a belief about one task.

        Of the inverse models' answers, one a model, that of least expected cost over all models counts.
        """
        method, to_action = self._method, self._to_action
        wanted = self._standardiser.standardise("outcome", targets)[None]
        state = self._standardiser.standardise("state", start)
        corner = torch.full_like(to_action.mean, LARGEST_LATENT)
        bounds = to_action(-corner), to_action(corner)
        many = self._standardiser.standardise("action", candidates)
        phi = draw_phi(method, belief, self._draws, self._generator)
        found = {
            name: choose_by_gradient(method, draws, state, many, wanted, bounds)
            for name, draws in ((GRADIENT, phi), (MEAN_ONLY, draw_phi(method, belief, 1, self._generator)))
        }
        with torch.no_grad():
            each = wanted.expand(method.models, *wanted.shape)
            answers = to_action(self._inverse(belief, each)).permute(1, 2, 0, 3)  # (B, T, M, latent)
            cost = expected_cost(
                method, phi, state, answers.expand(method.models, *answers.shape), each
            ).mean(0)
            found[INVERSE] = cheapest(cost, answers)
        return {name: self._back(action) for name, action in found.items()}

    def _back(self, action: Tensor) -> Array:
        return self._to_action.back(action)[0].double().numpy()


def _plan(
    chooser: Chooser,
    robot: Robot,
    task: RecordedTask,
    candidates: Array,
    settings: Mapping[str, Any],
    rng: np.random.Generator,
) -> tuple[pd.DataFrame, Array]:
    """What to do with one object: rows without their errors, and the latent (rows, latent) of each."""
    samples = settings["samples"]
    (adapt,), (query,) = split_hits(task.hits, max(samples), 1, rng, task.where)
    known = task.data["action"][rng.permutation(query)[: settings["targets"]]].astype(float)
    targets = robot.certain(known, [task.object] * len(known))
    beliefs = chooser.beliefs(task, adapt)
    chosen = {(ORACLE, -1): known}
    for seen in samples:
        found = chooser.latents(beliefs[seen], task.data["state"][0], candidates, targets)
        chosen |= {(name, seen): latents for name, latents in found.items()}
    rows = [(name, seen, i, *target) for name, seen in chosen for i, target in enumerate(targets)]
    columns = ["chooser", "samples", "target", "target_x_m", "target_y_m"]
    table = pd.DataFrame(rows, columns=columns).assign(object=task.object)
    return table, np.concatenate(list(chosen.values()))


if __name__ == "__main__":
    stage_command("acting", produce)
