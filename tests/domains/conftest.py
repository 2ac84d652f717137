from pathlib import Path

import numpy as np
import pytest
from slapshot.command import Run
from slapshot.config.files import load_config
from slapshot.config.trajectories import (
    DemonstrationsSettings,
    SwingsSettings,
    TrajectoryModelSettings,
)
from slapshot.rollouts.hits import Hits
from slapshot.scenes.domain import build_scene
from slapshot.scenes.randomisation import draw_conditions, draw_start_errors
from slapshot.scenes.scene import Scene
from slapshot.trajectories import demonstrations, fit, pool
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae
from slapshot.validation import values_of

ROOT = Path(__file__).parents[2]


class RigSimulator:
    """A domain's first stages, run for real at a small size."""

    def __init__(self, name: str, root: Path) -> None:
        self.name = name
        self.config = load_config(ROOT / "config/tiny.yaml").domains[name]
        folders = {stage: root / stage for stage in ("scene", "demonstrations", "trajectory_model", "swings")}
        for folder in folders.values():
            folder.mkdir()
        self.scene = build_scene(self.config.scene)
        self.scene.save(folders["scene"])
        scripted, motions = self.config.demonstrations, self.config.trajectory_model
        for produce, stage, settings in (
            (
                demonstrations.produce,
                "demonstrations",
                DemonstrationsSettings.from_parts(scripted, domain=name, seed=3, count=512),
            ),
            (
                fit.produce,
                "trajectory_model",
                TrajectoryModelSettings.from_parts(
                    motions, seed=3, duration_s=scripted.duration_s, steps=1500
                ),
            ),
            (pool.produce, "swings", SwingsSettings(domain=name, seed=3, train=12, validation=4, test=4)),
        ):
            produce(Run(values_of(settings), folders, folders[stage], 1))
        self.folders = folders
        self.loaded = Scene.load(folders["scene"])
        self.model = TrajectoryVae.load(folders["trajectory_model"])
        self.swings = Swings.load(folders["swings"])

    def hits(self, count: int, seed: int = 0) -> Hits:
        """Random swings under random conditions."""
        rng = np.random.default_rng(seed)
        randomisation = self.config.randomisation
        return Hits(
            swings=rng.integers(0, len(self.swings.latents), count),
            conditions=draw_conditions(randomisation, count, rng),
            start_errors=draw_start_errors(randomisation.start_error, count, rng),
        )


@pytest.fixture(scope="session")
def fetchslide(tmp_path_factory) -> RigSimulator:
    return RigSimulator("fetchslide", tmp_path_factory.mktemp("fetchslide"))


@pytest.fixture(scope="session")
def hockey(tmp_path_factory) -> RigSimulator:
    return RigSimulator("hockey", tmp_path_factory.mktemp("hockey"))


@pytest.fixture(params=["hockey", "fetchslide"])
def bench(request) -> RigSimulator:
    return request.getfixturevalue(request.param)
