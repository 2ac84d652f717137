"""Stage `swings`: a finite pool of sampled latents, each decoded, checked and executed once.

The robot's motion up to contact does not depend on the condition, so it is simulated once per latent and
reused by every hit. Training, validation and test draw from disjoint parts of the pool.
"""

import json
import logging
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.command import Run, stage_command
from slapshot.config.trajectories import SwingsSettings
from slapshot.errors import InputError
from slapshot.parquet import write_table
from slapshot.progress import progress
from slapshot.scenes.domain import load_part
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import SPLITS, Swings
from slapshot.trajectories.vae import TrajectoryVae

log = logging.getLogger("slapshot")

UNSAFE = "unsafe when executed"


class Execute(Protocol):
    """Interface of the part `execution` of a domain: moves the robot along each latent's motion.

    Returns the swings, and (n,) whether each stayed within limits and reached the object.
    """

    def __call__(
        self, scene: Scene, model: TrajectoryVae, latents: Array, splits: NDArray[np.int64], cores: int
    ) -> tuple[Swings, NDArray[np.bool_]]:
        """Execute `latents` (n, latent), which belong to `splits` (n,)."""


def produce(run: Run) -> None:
    """Write the pool, latents.parquet for reading by people, and refused.json (reason -> count)."""
    settings = run.settings(SwingsSettings)
    scene = Scene.load(run.inputs["scene"])
    model = TrajectoryVae.load(run.inputs["trajectory_model"])
    rng = np.random.default_rng(settings.seed)
    check = load_part(settings.domain, "safety").SafetyCheck(scene)
    execute: Execute = load_part(settings.domain, "execution").execute
    refused: dict[str, int] = {}
    parts: list[Swings] = []
    for index, split in enumerate(SPLITS):
        latents = _draw_latents(settings.count(split), split, model, check, rng, refused)
        executed, usable = execute(scene, model, latents, np.full(len(latents), index), run.cores)
        if not usable.all():
            refused[UNSAFE] = refused.get(UNSAFE, 0) + int((~usable).sum())
        if not usable.any():
            raise InputError("swings: no sampled latent stays within the limits when it is executed")
        parts.append(executed.of(usable))
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
    write_table(table, run.out / "latents.parquet")
    (run.out / "refused.json").write_text(json.dumps(refused, indent=2, sort_keys=True) + "\n")
    for reason, count in sorted(refused.items()):
        log.info("%d sampled latents refused: %s", count, reason)


def _draw_latents(
    count: int,
    split: str,
    model: TrajectoryVae,
    check: Any,
    rng: np.random.Generator,
    refused: dict[str, int],
) -> Array:
    """Sample (count, latent) safe latents; `refused` counts the reasons for which others were rejected."""
    latents: list[Array] = []
    tries = 0
    for _ in progress(range(count), count, f"{split} latents"):
        while True:
            latent = rng.normal(size=model.sizes.latent)
            tries += 1
            reason = check.report(model.motion(latent)).reason
            if not reason:
                break
            refused[reason] = refused.get(reason, 0) + 1
            if tries > 20 * (count + 10):
                raise InputError(
                    f"swings: {split}: only {len(latents)} of {tries} sampled latents are "
                    "safe; train the trajectory model longer or on narrower demonstrations"
                )
        latents.append(latent)
    return np.array(latents)


if __name__ == "__main__":
    stage_command("swings", produce)
