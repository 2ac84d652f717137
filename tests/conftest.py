import os
from pathlib import Path
from typing import NamedTuple

# Before MuJoCo is imported: tests that do not render need no GL library.
os.environ.setdefault("MUJOCO_GL", "disable")

import pytest
import torch
from slapshot.command import Run
from slapshot.config import load_config
from slapshot.scenes.domain import load_domain
from slapshot.scenes.scene import Scene
from slapshot.trajectories import demonstrations, fit, swings
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae

ROOT = Path(__file__).parents[1]


class Rig(NamedTuple):
    """A hockey scene with a small trajectory model and pool of swings, and the folders they lie in."""

    scene: Scene
    model: TrajectoryVae
    swings: Swings
    folders: dict[str, Path]


@pytest.fixture(autouse=True)
def torch_globals():
    """A test that changes torch's global state fails: others would depend on the order of tests."""
    before = (torch.get_default_dtype(), torch.is_grad_enabled())
    yield
    assert (torch.get_default_dtype(), torch.is_grad_enabled()) == before


@pytest.fixture(scope="session")
def hockey_config():
    return load_config(ROOT / "config/tiny.yaml", ROOT / "workflow/schemas/config.schema.yaml")["domains"][
        "hockey"
    ]


@pytest.fixture(scope="session")
def scene(hockey_config) -> Scene:
    return load_domain("hockey").build_scene(hockey_config["scene"])


@pytest.fixture(scope="session")
def rig(scene, hockey_config, tmp_path_factory) -> Rig:
    """The first stages, run for real at a small size."""
    root = tmp_path_factory.mktemp("rig")
    folders = {name: root / name for name in ("scene", "demonstrations", "trajectory_model", "swings")}
    for folder in folders.values():
        folder.mkdir()
    scene.save(folders["scene"])
    settings = hockey_config["demonstrations"]
    common = {"seed": 3, "duration_s": settings["duration_s"]}
    for produce, name, config in (
        (demonstrations.produce, "demonstrations", {"domain": "hockey", **settings, "count": 1024}),
        (
            fit.produce,
            "trajectory_model",
            {**hockey_config["trajectory_model"], "steps": 2500, "hidden": [128, 128]},
        ),
        (swings.produce, "swings", {"train": 24, "validation": 8, "test": 8}),
    ):
        produce(Run({**common, **config}, folders, folders[name], 2))
    model = TrajectoryVae.load(folders["trajectory_model"])
    return Rig(scene, model, Swings.load(folders["swings"]), folders)
