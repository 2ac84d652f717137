"""Stage `swings`: a finite pool of sampled latents, each decoded, checked and executed once.

Conditions differ only once the object is touched, so the arm's motion up to there is simulated once
per latent and reused by every hit. Training, validation and test draw from disjoint parts of the pool.
"""

import json
import logging
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mujoco.batch import Batch
from numpy.typing import NDArray
from safetensors.numpy import load_file, save_file

from slapshot.command import Run, stage_command
from slapshot.errors import InputError
from slapshot.progress import progress
from slapshot.scenes.scene import Scene
from slapshot.trajectories.safety import SafetyCheck
from slapshot.trajectories.vae import TrajectoryVae

log = logging.getLogger("slapshot")
Array = NDArray[np.float64]

SPLITS = ("train", "validation", "test")
WINDOW_BEFORE, WINDOW_AFTER = 0.20, 0.12  # s around the nominal contact in which a hit may begin
SETTLE = 0.05  # s simulated after the motion's end
# Share of a torque limit that an executed swing may use: contact forces come on top.
TORQUE_SHARE = 0.8
_FAR = 100.0  # m: where the object waits while the arm moves alone


@dataclass(frozen=True)
class Swings:
    """Swings of the arm alone; n swings, w ticks of the window, t ticks in all, j joints.

    Attributes:
        latents: (n, latent) actions.
        splits: (n,) index into SPLITS.
        targets: (n, t, j) servo targets in rad, one a control period.
        positions, velocities: (n, w, j) of the arm in rad and rad/s inside the window.
        first: (n,) tick at which a swing's window begins.
        striker: (n, t, 3) position in m of the striker's site.
        normal: (n, t, 3) unit normal of its striking face.
    """

    latents: Array
    splits: NDArray[np.int64]
    targets: Array
    positions: Array
    velocities: Array
    first: NDArray[np.int64]
    striker: Array
    normal: Array

    def of_split(self, split: str) -> NDArray[np.int64]:
        """Indices of the swings of a split."""
        return np.flatnonzero(self.splits == SPLITS.index(split))

    def save(self, folder: Path) -> None:
        """Write swings.safetensors."""
        arrays = {name: np.ascontiguousarray(value) for name, value in vars(self).items()}
        save_file(arrays, folder / "swings.safetensors")

    @classmethod
    def load(cls, folder: Path) -> "Swings":
        """Read what `save` wrote."""
        return cls(**load_file(folder / "swings.safetensors"))


def produce(run: Run) -> None:
    """Write the pool, latents.parquet for people, and refused.json (reason -> count)."""
    settings = run.config
    scene = Scene.load(run.inputs["scene"])
    model = TrajectoryVae.load(run.inputs["trajectory_model"])
    rng = np.random.default_rng(settings["seed"])
    check = SafetyCheck(scene)
    refused: dict[str, int] = {}
    parts: list[Swings] = []
    for index, split in enumerate(SPLITS):
        parts.append(_draw_split(settings[split], index, scene, model, check, rng, run.cores, refused))
    swings = Swings(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    )
    swings.save(run.out)
    table = pa.table(
        {
            "swing": np.arange(len(swings.latents)),
            "split": [SPLITS[i] for i in swings.splits],
            "latent": list(swings.latents),
        }
    )
    pq.write_table(table, run.out / "latents.parquet", compression="zstd")
    (run.out / "refused.json").write_text(json.dumps(refused, indent=2, sort_keys=True) + "\n")
    for reason, count in sorted(refused.items()):
        log.info("%d sampled latents refused: %s", count, reason)


def _draw_split(
    count: int,
    index: int,
    scene: Scene,
    model: TrajectoryVae,
    check: SafetyCheck,
    rng: np.random.Generator,
    cores: int,
    refused: dict[str, int],
) -> Swings:
    latents: list[Array] = []
    tries = 0
    for _ in progress(range(count), count, f"{SPLITS[index]} latents"):
        while True:
            latent = rng.normal(size=model.sizes.latent)
            tries += 1
            reason = check.report(model.motion(latent)).reason
            if not reason:
                break
            refused[reason] = refused.get(reason, 0) + 1
            if tries > 20 * (count + 10):
                raise InputError(
                    f"swings: {SPLITS[index]}: only {len(latents)} of {tries} sampled latents are "
                    "safe; train the trajectory model longer or on narrower demonstrations"
                )
        latents.append(latent)
    stacked = np.array(latents)
    swings, usable = execute(scene, model, stacked, np.full(count, index), cores)
    if not usable.all():
        refused["unsafe when executed"] = refused.get("unsafe when executed", 0) + int((~usable).sum())
    if not usable.any():
        raise InputError("swings: no sampled latent stays within the torque and speed limits")
    return Swings(**{name: value[usable] for name, value in vars(swings).items()})


def execute(
    scene: Scene, model: TrajectoryVae, latents: Array, splits: NDArray[np.int64], cores: int
) -> tuple[Swings, NDArray[np.bool_]]:
    """Move the arm along each latent's motion, with the object out of the way.

    Returns:
        The swings, and (n,) whether speeds and torques stayed within limits and the object was reached.
    """
    info, layout = scene.info, scene.layout
    mj_model = scene.compile()
    substeps = round(info.control_period / mj_model.opt.timestep)
    ticks = round((model.sizes.duration + SETTLE) / info.control_period)
    times = np.arange(ticks, dtype=np.float64) * info.control_period
    motions = [model.motion(latent) for latent in latents]
    targets = np.stack([motion.servo_targets(times, info.servo_time) for motion in motions])
    count, joints = len(latents), len(info.joints)

    batch = Batch(mj_model, nsim=count, nthread=cores)
    batch.reset()
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    site, rotation, force = (
        batch.bind("site_xpos"),
        batch.bind("site_xmat"),
        batch.bind("actuator_force"),
    )
    qpos[:, layout.arm_q] = np.stack([motion.position(times[:1])[0] for motion in motions])
    qpos[:, layout.object_q[0]] += _FAR
    positions, velocities = np.empty((2, count, ticks, joints))
    striker, normal = np.empty((2, count, ticks, 3))
    torque = np.zeros((count, joints))
    batch.forward()
    for tick in progress(range(ticks), ticks, "executing swings"):
        positions[:, tick], velocities[:, tick] = qpos[:, layout.arm_q], qvel[:, layout.arm_v]
        striker[:, tick] = site[:, layout.striker_site]
        normal[:, tick] = rotation[:, layout.striker_site].reshape(count, 3, 3)[:, :, 0]
        ctrl[:, :joints] = targets[:, tick]
        batch.step(nstep=substeps, stage=mujoco.mjtStage.mjSTAGE_POS)
        torque = np.maximum(torque, np.abs(force[:, :joints]))
    gap = striker_gap(scene, striker, normal, np.broadcast_to(np.array(info.start), (count, 2)))
    contact = (gap < 0).argmax(1)
    first = np.clip(contact - round(WINDOW_BEFORE / info.control_period), 0, None)
    window = round((WINDOW_BEFORE + WINDOW_AFTER) / info.control_period)
    usable = (
        (gap < 0).any(1)
        & (torque < TORQUE_SHARE * np.array(info.torque_limits)).all(1)
        & (np.abs(velocities).max(1) < np.array(info.speed_limits)).all(1)
        & (first + window < ticks)
    )
    rows = np.minimum(first[:, None] + np.arange(window), ticks - 1)[:, :, None]
    swings = Swings(
        latents=latents,
        splits=np.asarray(splits, np.int64),
        targets=targets,
        positions=np.take_along_axis(positions, rows, 1),
        velocities=np.take_along_axis(velocities, rows, 1),
        first=first.astype(np.int64),
        striker=striker,
        normal=normal,
    )
    return swings, usable


def striker_gap(scene: Scene, striker: Array, normal: Array, place: Array) -> Array:
    """(n, t) distance in m between the striking face and an object at `place` (n, 2)."""
    level = normal[:, :, :2] / np.linalg.norm(normal[:, :, :2], axis=2, keepdims=True)
    ahead = ((place[:, None] - striker[:, :, :2]) * level).sum(2)
    return ahead - scene.info.striker_half_thickness - scene.info.object_radius


if __name__ == "__main__":
    stage_command("swings", produce)
