"""Stage `demonstrations`: scripted task trajectories that are within every limit (S5)."""

import logging

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from slapshot.command import Run, stage_command
from slapshot.errors import InputError
from slapshot.progress import progress
from slapshot.scenes.domain import load_domain
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion
from slapshot.trajectories.safety import SafetyCheck

log = logging.getLogger("slapshot")

_BLOCK = 64


def produce(run: Run) -> None:
    """Write demonstrations.parquet: one row a safe demonstration, its task and its waypoints."""
    settings, count = run.config, run.config["count"]
    scene = Scene.load(run.inputs["scene"])
    domain = load_domain(settings["domain"])
    check = SafetyCheck(scene)
    rng = np.random.default_rng(settings["seed"])
    rows: list[dict] = []
    refused: dict[str, int] = {}
    blocks = -(-count // _BLOCK)
    for _ in progress(range(blocks), blocks, "demonstrations"):
        tasks = [domain.draw_task(settings, rng) for _ in range(_BLOCK)]
        found = domain.demonstrate(scene, settings, tasks)
        for task, waypoints in zip(tasks, found, strict=True):
            reason = "out of reach"
            if waypoints is not None:
                motion = Motion.through(waypoints, settings["duration_s"])
                reason = check.report(motion).reason
            if waypoints is None or reason:
                refused[reason] = refused.get(reason, 0) + 1
            else:
                rows.append({**task, "waypoints": waypoints.ravel()})
    for reason, times in sorted(refused.items()):
        log.info("%d of %d tasks refused: %s", times, blocks * _BLOCK, reason)
    if len(rows) < blocks * _BLOCK / 2:
        raise InputError(
            f"demonstrations: only {len(rows)} of {blocks * _BLOCK} tasks can be executed safely; "
            "narrow heading_rad, speed_m_s or contact_offset_m"
        )
    pq.write_table(pa.Table.from_pylist(rows), run.out / "demonstrations.parquet", compression="zstd")


if __name__ == "__main__":
    stage_command("demonstrations", produce)
