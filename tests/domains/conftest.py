from pathlib import Path

import numpy as np
import pytest
from slapshot.command import Run
from slapshot.config import load_config
from slapshot.rollouts.hits import Hits
from slapshot.scenes.domain import load_domain
from slapshot.scenes.randomisation import draw_conditions, draw_start_errors
from slapshot.scenes.scene import Scene
from slapshot.trajectories import demonstrations, fit, pool
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae

ROOT = Path(__file__).parents[2]


class RigSimulator:
    """A domain's first stages, run for real at a small size."""

    def __init__(self, name: str, root: Path) -> None:
        self.name = name
        self.config = load_config(ROOT / "config/tiny.yaml")["domains"][name]
        folders = {stage: root / stage for stage in ("scene", "demonstrations", "trajectory_model", "swings")}
        for folder in folders.values():
            folder.mkdir()
        self.scene = load_domain(name).build_scene(self.config["scene"])
        self.scene.save(folders["scene"])
        settings = self.config["demonstrations"]
        common = {"domain": name, "seed": 3, "duration_s": settings["duration_s"]}
        for produce, stage, own in (
            (demonstrations.produce, "demonstrations", {**settings, "count": 512}),
            (fit.produce, "trajectory_model", {**self.config["trajectory_model"], "steps": 1500}),
            (pool.produce, "swings", {"train": 12, "validation": 4, "test": 4}),
        ):
            produce(Run({**common, **own}, folders, folders[stage], 1))
        self.folders = folders
        self.loaded = Scene.load(folders["scene"])
        self.model = TrajectoryVae.load(folders["trajectory_model"])
        self.swings = Swings.load(folders["swings"])

    def hits(self, count: int, seed: int = 0) -> Hits:
        """Random swings under random conditions."""
        rng = np.random.default_rng(seed)
        randomisation = self.config["randomisation"]
        return Hits(
            swings=rng.integers(0, len(self.swings.latents), count),
            conditions=draw_conditions(randomisation, count, rng),
            start_errors=draw_start_errors(randomisation, count, rng),
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
