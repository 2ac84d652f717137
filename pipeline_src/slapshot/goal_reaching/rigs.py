"""Execution of latents on an interactive rig by safe commands, and tensors of their outcomes."""

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

_SHRINK = 0.9  # factor on an unsafe latent until it is safe: 0 is the mean of the demonstrations
_MOST_SHRINKING = 40
_MOST_REPEATS = 10


class Robot:
    """Executes latents on an interactive rig."""

    def __init__(self, rig: LiveRig, model: TrajectoryVae, check: SafetyCheck) -> None:
        self._rig, self._model, self._check = rig, model, check

    def hit(self, latents: Array, object_ids: Sequence[str], rng: np.random.Generator) -> Array:
        """Observed rest points (n, 2) in m.

        An unsafe latent is shrunk until it is safe; a hit whose rest point the camera misses is repeated.

        Raises:
            InputError: the camera never sees some of the rest points.
        """
        motions = [self.safe(latent)[1] for latent in latents]

        def execute(rows: list[int]) -> Array:
            return self._rig.execute([motions[i] for i in rows], [object_ids[i] for i in rows], rng)

        return _until_seen(len(latents), execute)

    def sample(self, count: int, object_id: str, rng: np.random.Generator) -> tuple[Array, Array]:
        """Safe latents (count, latent) and the observed rest points (count, 2) in m.

        A latent whose rest point the camera misses is drawn anew: at low friction some hits leave its view.

        Raises:
            InputError: the camera sees too few rest points.
        """
        latents = np.empty((count, self._model.sizes.latent))

        def execute(rows: list[int]) -> Array:
            latents[rows] = self.candidates(len(rows), rng)
            motions = [self._model.motion(latent) for latent in latents[rows]]
            return self._rig.execute(motions, [object_id] * len(rows), rng)

        rests = _until_seen(count, execute)
        return latents, rests

    def certain(self, latents: Array, object_ids: Sequence[str]) -> Array:
        """Noiseless rest points (n, 2) in m, which only an oracle knows."""
        return self._rig.without_chance([self.safe(latent)[1] for latent in latents], object_ids)

    def safe(self, latent: Array) -> tuple[Array, Motion]:
        """The latent, or the first safe one as it is shrunk towards 0, and its motion."""
        for _ in range(_MOST_SHRINKING):
            motion = self._model.motion(latent)
            if self._check.report(motion).safe:
                break
            latent = _SHRINK * latent
        return latent, motion

    def candidates(self, count: int, rng: np.random.Generator) -> Array:
        """Safe latents (count, latent) drawn from the unit Gaussian."""
        found: list[Array] = []
        while len(found) < count:
            latent = rng.normal(size=self._model.sizes.latent)
            if self._check.report(self._model.motion(latent)).safe:
                found.append(latent)
        return np.array(found)


def robot_of(settings: RobotSettings, inputs: Mapping[str, Path], cores: int) -> Robot:
    """The robot that a stage hits.

    Args:
        settings: of the stage.
        inputs: folders of scene and trajectory_model.
        cores: to use.
    """
    scene = Scene.load(inputs["scene"])
    rig = LiveRig(scene, settings.lab, [settings.seed, settings.rig], cores)
    check = load_part(settings.domain, "safety").SafetyCheck(scene)
    return Robot(rig, TrajectoryVae.load(inputs["trajectory_model"]), check)


def sampled_hits(robot: Robot, task: RecordedTask, count: int, rng: np.random.Generator) -> dict[str, Array]:
    """State, action and outcome, (count, size) each, of new hits on a task's object with sampled latents."""
    latents, rests = robot.sample(count, task.object, rng)
    return {"state": np.tile(task.data["state"][0], (count, 1)), "action": latents, "outcome": rests}


def _until_seen(count: int, execute: Callable[[list[int]], Array]) -> Array:
    """Rest points (count, 2) in m; `execute` makes the hits of given rows and returns NaN for unseen ones."""
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
    """Repeat values (...) that all models share to (M, ...)."""
    tensor = torch.as_tensor(np.asarray(values), dtype=torch.float32)
    return tensor.expand(models, *tensor.shape)
