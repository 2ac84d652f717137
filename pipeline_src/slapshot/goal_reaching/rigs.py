"""A rig to act on: safe commands from latents, and the tensors that an ensemble wants."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from slapshot.adaptation.recorded import RecordedTask
from slapshot.arrays import Array
from slapshot.config.acting import RobotSettings
from slapshot.errors import InputError
from slapshot.lab.interactive_rig import LiveRig
from slapshot.scenes.domain import load_part
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyCheck
from slapshot.trajectories.vae import TrajectoryVae

_SHRINK = 0.9  # of a latent that is not safe, until it is: 0 stands for the demonstrations' middle
_MOST_SHRINKING = 40
_MOST_REPEATS = 10


class Robot:
    """Executes latents on a live rig."""

    def __init__(self, rig: LiveRig, model: TrajectoryVae, check: SafetyCheck) -> None:
        self._rig, self._model, self._check = rig, model, check

    def hit(self, latents: Array, object_ids: Sequence[str], rng: np.random.Generator) -> Array:
        """(n, 2) m, where objects are seen to rest.

        A latent that is not safe is shrunk until it is; a hit whose end the camera misses is made again.

        Raises:
            InputError: the camera never sees some of them rest.
        """
        motions = [self.safe(latent)[1] for latent in latents]

        def execute(rows: list[int]) -> Array:
            return self._rig.execute([motions[i] for i in rows], [object_ids[i] for i in rows], rng)

        return _until_seen(len(latents), execute)

    def sample(self, count: int, object_id: str, rng: np.random.Generator) -> tuple[Array, Array]:
        """Safe latents (count, latent) and (count, 2) m, where an object is seen to rest after each.

        A latent whose end the camera misses is drawn anew: where friction is low some lead out of its view.

        Raises:
            InputError: the camera sees too few of them rest.
        """
        latents = np.empty((count, self._model.sizes.latent))

        def execute(rows: list[int]) -> Array:
            latents[rows] = self.candidates(len(rows), rng)
            motions = [self._model.motion(latent) for latent in latents[rows]]
            return self._rig.execute(motions, [object_id] * len(rows), rng)

        rests = _until_seen(count, execute)
        return latents, rests

    def certain(self, latents: Array, object_ids: Sequence[str]) -> Array:
        """(n, 2) m, where they would rest without chance: what an oracle knows."""
        return self._rig.without_chance([self.safe(latent)[1] for latent in latents], object_ids)

    def safe(self, latent: Array) -> tuple[Array, Motion]:
        """The latent, or the first safe one on its way to 0, and its motion."""
        for _ in range(_MOST_SHRINKING):
            motion = self._model.motion(latent)
            if self._check.report(motion).safe:
                break
            latent = _SHRINK * latent
        return latent, motion

    def candidates(self, count: int, rng: np.random.Generator) -> Array:
        """(count, latent) safe latents from the unit Gaussian."""
        found: list[Array] = []
        while len(found) < count:
            latent = rng.normal(size=self._model.sizes.latent)
            if self._check.report(self._model.motion(latent)).safe:
                found.append(latent)
        return np.array(found)


def robot_of(settings: RobotSettings, inputs: Mapping[str, Path], cores: int) -> Robot:
    """The robot that a stage is told of.

    Args:
        settings: what it is told.
        inputs: scene and trajectory_model.
        cores: to use.
    """
    scene = Scene.load(inputs["scene"])
    rig = LiveRig(scene, settings.lab, [settings.seed, settings.rig], cores)
    check = load_part(settings.domain, "safety").SafetyCheck(scene)
    return Robot(rig, TrajectoryVae.load(inputs["trajectory_model"]), check)


def sampled_hits(robot: Robot, task: RecordedTask, count: int, rng: np.random.Generator) -> dict[str, Array]:
    """State, action and outcome, (count, size) each, of new hits of a task's object with sampled latents."""
    latents, rests = robot.sample(count, task.object, rng)
    return {"state": np.tile(task.data["state"][0], (count, 1)), "action": latents, "outcome": rests}


def _until_seen(count: int, execute: Callable[[list[int]], Array]) -> Array:
    """(count, 2) m; `execute` makes hits of these rows and says where each ends, NaN if unseen."""
    rests = np.full((count, 2), np.nan)
    for _ in range(_MOST_REPEATS):
        unseen = np.flatnonzero(np.isnan(rests[:, 0])).tolist()
        if not unseen:
            break
        rests[unseen] = execute(unseen)
    missed = int(np.isnan(rests[:, 0]).sum())
    if missed:
        raise InputError(
            f"the camera misses where {missed} hits end, {_MOST_REPEATS} times each; "
            "widen lab.camera.view_m or lower its missing_share"
        )
    return rests


def batched(values: NDArray[np.floating] | Tensor, models: int) -> Tensor:
    """(M, ...) of values (...) that all models share."""
    tensor = torch.as_tensor(np.asarray(values), dtype=torch.float32)
    return tensor.expand(models, *tensor.shape)
