"""Stage `demonstrations`: scripted trajectories that satisfy all safety limits (S5)."""

import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from slapshot.command import Run, stage_command
from slapshot.config.trajectories import DemonstrationsSettings
from slapshot.errors import InputError
from slapshot.parquet import table_writer
from slapshot.progress import progress
from slapshot.scenes.domain import load_domain, load_part
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion

log = logging.getLogger("slapshot")

_BLOCK = 64  # tasks drawn at a time, so that the first n demonstrations do not depend on their number
_ROWS_PER_GROUP = 8192


def produce(run: Run) -> None:
    """Write demonstrations.parquet: one row per safe demonstration, with its task and waypoints (rad)."""
    settings = run.settings(DemonstrationsSettings)
    scene = Scene.load(run.inputs["scene"])
    blocks = -(-settings.count // _BLOCK)
    refused: Counter[str] = Counter()
    accepted = 0
    with _Writer(run.out / "demonstrations.parquet", settings.waypoints * scene.info.commands) as writer:
        for found, reasons in progress(_blocks(scene, settings, blocks), blocks, "demonstrations"):
            writer.add(found)
            accepted += len(found)
            refused.update(reasons)
    for reason, times in sorted(refused.items()):
        log.info("%d of %d tasks refused: %s", times, blocks * _BLOCK, reason)
    if accepted < blocks * _BLOCK / 2:
        raise InputError(
            f"demonstrations: only {accepted} of {blocks * _BLOCK} tasks can be executed safely; "
            "narrow heading_rad, speed_m_s or contact_offset_m"
        )


def _blocks(
    scene: Scene, settings: DemonstrationsSettings, blocks: int
) -> Iterator[tuple[list[dict[str, Any]], list[str]]]:
    """Safe demonstrations, and the reasons for which other tasks were rejected, block by block."""
    domain = load_domain(settings.domain)
    check = load_part(settings.domain, "safety").SafetyCheck(scene)
    rng = np.random.default_rng(settings.seed)
    for _ in range(blocks):
        tasks = [domain.draw_task(settings, rng) for _ in range(_BLOCK)]
        found, reasons = [], []
        for task, waypoints in zip(tasks, domain.demonstrate(scene, settings, tasks), strict=True):
            if waypoints is None:
                reasons.append("out of reach")
                continue
            report = check.report(Motion.through(waypoints, settings.duration_s))
            if report.safe:
                found.append({**task, "waypoints": waypoints.ravel()})
            else:
                reasons.append(report.reason)
        yield found, reasons


class _Writer:
    """A Parquet file written in row groups, so that memory is bounded."""

    def __init__(self, path: Path, size: int) -> None:
        self._path, self._size = path, size
        self._rows: list[dict[str, Any]] = []
        self._writer: pq.ParquetWriter | None = None

    def __enter__(self) -> "_Writer":
        return self

    def add(self, rows: list[dict[str, Any]]) -> None:
        self._rows += rows
        if len(self._rows) >= _ROWS_PER_GROUP:
            self._flush()

    def __exit__(self, *_: object) -> None:
        if self._rows:
            self._flush()
        if self._writer is not None:
            self._writer.close()

    def _flush(self) -> None:
        table = pa.Table.from_pylist(self._rows)
        kind = pa.list_(pa.float32(), self._size)
        waypoints = table["waypoints"].cast(pa.list_(pa.float32())).cast(kind)
        table = table.set_column(table.schema.get_field_index("waypoints"), "waypoints", waypoints)
        self._writer = self._writer or table_writer(self._path, table.schema)
        self._writer.write_table(table)
        self._rows = []


if __name__ == "__main__":
    stage_command("demonstrations", produce)
