from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from slapshot.command import Run
from slapshot.config.scene import HockeyScene
from slapshot.lab.__main__ import produce
from slapshot.lab.board import FLAT
from slapshot.lab.hidden_effects.hidden_effect import Concealed, NominalMotion
from slapshot.lab.hidden_effects.registry import HIDDEN_EFFECTS
from slapshot.lab.release_detection import nearest_pose
from slapshot.lab.rig import Camera, ObjectTruth, Rig, Scatter
from slapshot.scenes.domain import build_scene, load_domain
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.vae import TrajectoryVae, VaeSizes
from slapshot.validation import validated
from told import scripted_hits

SCENE = {
    "domain": "hockey",
    "puck": "inline",
    "timestep_s": 0.0005,
    "start_m": [0.55, 0.0],
    "board_m": [2.4, 1.2],
}
DEMONSTRATIONS = scripted_hits()
LATENT = 3


@pytest.fixture(scope="session")
def lab_scene() -> Scene:
    return build_scene(validated(HockeyScene, SCENE, "scene"))


@pytest.fixture(scope="session")
def waypoints(lab_scene) -> np.ndarray:
    """(demonstrations, 17, 7) in rad."""
    domain, rng = load_domain("hockey"), np.random.default_rng(0)
    tasks = [domain.draw_task(DEMONSTRATIONS, rng) for _ in range(24)]
    found = domain.demonstrate(lab_scene, DEMONSTRATIONS, tasks)
    return np.stack([w for w in found if w is not None])


@pytest.fixture(scope="session")
def motions(waypoints) -> list[Motion]:
    return [Motion.through(w, DEMONSTRATIONS.duration_s) for w in waypoints]


@pytest.fixture(scope="session")
def folders(lab_scene, waypoints, tmp_path_factory) -> dict[str, Path]:
    """A scene, and a trajectory model whose decoder is the principal components of demonstrations."""
    flat = waypoints.reshape(len(waypoints), -1)
    _, size, direction = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    shape = waypoints.shape[1:]
    sizes = VaeSizes(shape[0], shape[1], LATENT, hidden=(), duration=DEMONSTRATIONS.duration_s)
    model = TrajectoryVae(sizes)
    # Half of the demonstrations' spread keeps sampled latents among them.
    spread = 0.5 * size[:LATENT, None] / np.sqrt(len(flat))
    with torch.no_grad():
        model.decoder[0].weight.copy_(torch.as_tensor((direction[:LATENT] * spread).T))
        model.decoder[0].bias.copy_(torch.as_tensor(flat.mean(0)))
    root = tmp_path_factory.mktemp("lab")
    found = {name: root / name for name in ("scene", "trajectory_model")}
    for folder in found.values():
        folder.mkdir()
    lab_scene.save(found["scene"])
    model.save(found["trajectory_model"])
    return found


@pytest.fixture
def lab_settings() -> dict[str, Any]:
    """Block `lab` of a configuration: everything there, and small."""
    friction = {"friction_x": [0.3, 0.4], "friction_ratio": [0.9, 1.1], "friction_torsional_m": 0.005}
    return {
        "hits": 4,
        "repeats": {"commands": 1, "times": 2},
        "objects": {
            "red": {"mass_kg": [0.09, 0.12], **friction},
            "blue": {"mass_kg": [0.156, 0.17], **friction},
        },
        "scale_sd_kg": 0.001,
        "blade": {
            "segments": 3,
            "stiffness_nm_rad": [15, 25],
            "twist_stiffness_nm_rad": None,
            "damping_ratio": 0.1,
        },
        "board": {"rms_slope": 0.01, "wavelength_m": [0.3, 1.5], "waves": 12},
        "friction_field": {"rms": 0.03, "wavelength_m": [0.3, 1.5], "waves": 6},
        "scatter": {
            "start_error_sd_m": 0.01,
            "speed_sd": 0.02,
            "joint_offset_sd_rad": [0.01, 0.003, 0.01, 0.003, 0.01, 0.003, 0.01],
            "friction_sd": 0.03,
        },
        "camera": {
            "rate_hz": 30,
            "noise_sd_m": 0.003,
            "noise_time_s": 0.02,
            "stamp_jitter_share": 0.0,
            "outlier_share": 0.0,
            "missing_share": 0.03,
            "mistrack_share": 0.003,
            "mistrack_m": [0.05, 0.2],
            "after_rest_s": 0.5,
            "view_m": [-0.2, 3.0, -1.5, 1.5],
            "yaw_sd_rad": None,
        },
        "joints": {"rate_hz": 100, "noise_sd_rad": 0.001},
        "concealed": [],
        "commands": "latents",
        "keep": "full",
    }


@pytest.fixture
def make(folders, lab_settings, tmp_path) -> Callable[..., Path]:
    """name, seed, rig, changed settings -> folder that the stage wrote."""

    def _make(
        name: str,
        seed: int = 1,
        model: str | None = "0123456789ab",
        rig: int = 0,
        cores: int = 1,
        **changed: Any,
    ) -> Path:
        out = tmp_path / name
        out.mkdir()
        lab = {**lab_settings, **changed}
        config = {"seed": seed, "rig": rig, "scene": SCENE, "trajectory_model_id": model, "lab": lab}
        if model is None:
            del config["trajectory_model_id"]
        produce(Run(config, folders, out, cores))
        return out

    return _make


@pytest.fixture(scope="session")
def plain_rig() -> Rig:
    """A null rig: nothing that the scene lacks, and no scatter."""
    return Rig(
        objects={
            "puck": ObjectTruth(0.105, 0.35, 0.33, 0.005),
            "skewed": ObjectTruth(0.163, 0.3, 0.4, 0.005),
        },
        blade=None,
        height=FLAT,
        log_friction=FLAT,
        scatter=Scatter(0.0, 0.0, (0.0,) * 7, 0.0),
        camera=Camera(30.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (0.05, 0.2), 0.5, None),
    )


@pytest.fixture(scope="session")
def nominal(lab_scene, motions) -> NominalMotion:
    """Where things happen, as a rehearsal would find it."""
    rests = np.random.default_rng(3).uniform([0.9, -0.4], [1.6, 0.4], (12, 2))
    poses = np.array([nearest_pose(lab_scene, motion) for motion in motions[:6]])
    return NominalMotion(lab_scene, np.array([1.65, 0.0]), poses, rests)


@pytest.fixture(scope="session")
def conceal(nominal, plain_rig) -> Callable[..., Rig]:
    """HiddenEffect, amplitude, parts of its shape -> the rig that conceals this alone."""

    def _conceal(name: str, amplitude: float, **shape: Any) -> Rig:
        effect = HIDDEN_EFFECTS[name]
        drawn = effect.draw(nominal, np.random.default_rng(0)) | shape
        return replace(plain_rig, concealed=(Concealed(effect, amplitude, drawn),))

    return _conceal
