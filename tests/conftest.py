"""Fixtures that many tests share.

No test may fail because a clock ran: it waits for an event or for progress (waiting.py, whose limit only a
hang reaches), never for a time. What must be fast is a ratio in `snakemake benchmark`.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

# Before MuJoCo is imported: tests that do not render need no GL library.
os.environ.setdefault("MUJOCO_GL", "disable")
# As Snakemake tells its jobs. Matrices are small, and waiting threads take the cores of other tests.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
import pytest
import torch
import yaml
from hypothesis import HealthCheck, settings
from slapshot.command import Run
from slapshot.config.domain import Domain
from slapshot.config.files import load_config
from slapshot.config.trajectories import (
    DemonstrationsSettings,
    SwingsSettings,
    TrajectoryModelSettings,
)
from slapshot.memory import keep_freed_memory
from slapshot.rollouts.hits import Hits
from slapshot.scenes.domain import build_scene
from slapshot.scenes.randomisation import draw_conditions, draw_start_errors
from slapshot.scenes.scene import Scene
from slapshot.store.lock import held
from slapshot.trajectories import demonstrations, fit, pool
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae
from slapshot.validation import values_of
from workspace import Workspace, copy_repository, read_yaml

ROOT = Path(__file__).parents[1]

# The same examples every time, and however long they take.
settings.register_profile(
    "slapshot", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("slapshot")
# As in commands.
keep_freed_memory()


class Rig(NamedTuple):
    """A hockey scene with a small trajectory model and pool of swings, and the folders they lie in."""

    scene: Scene
    model: TrajectoryVae
    swings: Swings
    folders: dict[str, Path]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest file comes first and makes the run that others share, which come last and need not wait."""

    def turn(item: pytest.Item) -> int:
        shares = item.get_closest_marker("workflow") is not None
        return 1 if not shares else 0 if item.path.name == "test_workflow.py" else 2

    items.sort(key=turn)


@pytest.fixture(autouse=True)
def torch_globals():
    """A test that changes torch's global state fails: others would depend on the order of tests."""
    before = (torch.get_default_dtype(), torch.is_grad_enabled())
    yield
    assert (torch.get_default_dtype(), torch.is_grad_enabled()) == before


@pytest.fixture(scope="session")
def hockey_config() -> Domain:
    return load_config(ROOT / "config/tiny.yaml").domains["hockey"]


@pytest.fixture(scope="session")
def scene(hockey_config) -> Scene:
    return build_scene(hockey_config.scene)


@pytest.fixture(scope="session")
def rig(scene, hockey_config, tmp_path_factory) -> Rig:
    """The first stages, run for real at a small size."""
    root = tmp_path_factory.mktemp("rig")
    folders = {name: root / name for name in ("scene", "demonstrations", "trajectory_model", "swings")}
    for folder in folders.values():
        folder.mkdir()
    scene.save(folders["scene"])
    scripted, motions = hockey_config.demonstrations, hockey_config.trajectory_model
    for produce, name, told in (
        (
            demonstrations.produce,
            "demonstrations",
            DemonstrationsSettings.from_parts(scripted, domain="hockey", seed=3, count=1024),
        ),
        (
            fit.produce,
            "trajectory_model",
            TrajectoryModelSettings.from_parts(
                motions, seed=3, duration_s=scripted.duration_s, steps=2500, hidden=(128, 128)
            ),
        ),
        (pool.produce, "swings", SwingsSettings(domain="hockey", seed=3, train=24, validation=8, test=8)),
    ):
        produce(Run(values_of(told), folders, folders[name], 2))
    model = TrajectoryVae.load(folders["trajectory_model"])
    return Rig(scene, model, Swings.load(folders["swings"]), folders)


@pytest.fixture(scope="session")
def make_hits(rig, hockey_config):
    """count, seed -> hits of random swings under random conditions."""

    def make(count: int, seed: int = 0) -> Hits:
        rng = np.random.default_rng(seed)
        randomisation = hockey_config.randomisation
        return Hits(
            swings=rng.integers(0, len(rig.swings.latents), count),
            conditions=draw_conditions(randomisation, count, rng),
            start_errors=draw_start_errors(randomisation.start_error, count, rng),
        )

    return make


@pytest.fixture(scope="session")
def can_render() -> bool:
    """Whether this machine has a GL library for the figures that show the scene."""
    code = (
        "from slapshot.figures.rendering import render\nimport mujoco\n"
        "model = mujoco.MjModel.from_xml_string("
        "'<mujoco><worldbody><camera name=\"c\"/></worldbody></mujoco>')\n"
        "data = mujoco.MjData(model)\nmujoco.mj_forward(model, data)\nrender(model, data, 'c', 32, 32)\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=False)
    return done.returncode == 0


@pytest.fixture(scope="session")
def new_workspace(tmp_path_factory, can_render) -> Callable[[str], Workspace]:
    """Makes a copy whose configuration is the tiny one, without what cannot be drawn here."""

    def make(name: str) -> Workspace:
        workspace = copy_repository(tmp_path_factory.mktemp(name))
        config = read_yaml(ROOT / "config/tiny.yaml")
        default = read_yaml(ROOT / "config/default.yaml")
        for key, domain in config["domains"].items():
            figures = domain.get("figures", default["domains"][key]["figures"])
            domain["figures"] = [f for f in figures if can_render or f != "F6"]
        workspace.config.write_text(yaml.safe_dump(config))
        return workspace

    return make


@pytest.fixture(scope="session")
def workspace(new_workspace, tmp_path_factory) -> Workspace:
    """A copy in which everything has been made, which all processes of pytest have from one run."""
    own = tmp_path_factory.getbasetemp()
    shared = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    made = shared / "workspace.txt"
    with held(shared / "workspace.lock", "makes everything once"):
        if not made.exists():
            workspace = new_workspace("workflow")
            workspace.snakemake("figures")
            made.write_text(str(workspace.root))
    root = Path(made.read_text())
    return Workspace(root, root / "test.yaml").clone(own / "workspace")
