"""Stage `rollouts`: simulate conditions x hits, write them to Parquet; resumes an interrupted run."""

import logging
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from slapshot.command import Run, stage_command
from slapshot.config.rollouts import RolloutsSettings
from slapshot.progress import progress
from slapshot.rollouts.dataset import (
    TRACKS_SCHEMA,
    concatenate,
    hits_schema,
    hits_table,
    tracks_table,
    write_atomically,
)
from slapshot.rollouts.hits import HitCollector
from slapshot.rollouts.plan import RolloutPlan, Shard
from slapshot.scenes.domain import load_part
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import SPLITS, Swings

log = logging.getLogger("slapshot")


def produce(run: Run) -> None:
    """Write hits-<split>.parquet, conditions.parquet and tracks.parquet."""
    simulate(run.settings(RolloutsSettings), run.inputs, run.out, run.cores)


def simulate(settings: RolloutsSettings, inputs: Mapping[str, Path], out: Path, cores: int) -> None:
    """Write the tables of `produce`, from the versions `scene` and `swings`.

    Shards are written to parts/ as they are simulated, so that a killed run loses at most one.
    """
    scene = Scene.load(inputs["scene"])
    swings = Swings.load(inputs["swings"])
    plan = RolloutPlan(settings, swings)
    shards = plan.shards()
    parts, joined = out / "parts", out / ".joined"
    if not joined.exists():
        parts.mkdir(exist_ok=True)
        waiting = [s for s in shards if not _part(parts, s, "tracks").exists()]
        if len(waiting) < len(shards):
            log.info("%d of %d shards are there already", len(shards) - len(waiting), len(shards))
        collector = load_part(settings.domain, "collector").Collector(scene, swings, cores)
        done = len(shards) - len(waiting)
        for shard in progress(waiting, len(shards), "rollout shards", done):
            _simulate(shard, plan, collector, swings, settings.track_period_s, parts)
        _join(plan, shards, swings, parts, out)
        parts.rename(joined)
    shutil.rmtree(joined)


def _part(parts: Path, shard: Shard, kind: str) -> Path:
    return parts / f"{kind}-{shard.name}.parquet"


def _simulate(
    shard: Shard,
    plan: RolloutPlan,
    collector: HitCollector,
    swings: Swings,
    period: float,
    parts: Path,
) -> None:
    """Simulate one shard and write its two parts; the tracks come last and mark the shard as done."""
    hits, tracked = plan.hits_of(shard)
    outcomes = collector.collect(hits)
    table = hits_table(hits, outcomes, swings, shard.conditions)
    write_atomically(table, _part(parts, shard, "hits"))
    rows = np.flatnonzero(tracked)
    tracks = []
    if len(rows):
        tracks = collector.collect_with_tracks(hits.rows(rows), period)[1]
    keys = pd.DataFrame({name: table[name].to_numpy()[rows] for name in ("condition", "hit")})
    write_atomically(tracks_table(shard.split, keys, tracks), _part(parts, shard, "tracks"))


def _join(plan: RolloutPlan, shards: list[Shard], swings: Swings, parts: Path, out: Path) -> None:
    schema = hits_schema(swings.latents.shape[1])
    for split in SPLITS:
        files = [_part(parts, s, "hits") for s in shards if s.split == split]
        concatenate(files, out / f"hits-{split}.parquet", schema)
    concatenate([_part(parts, s, "tracks") for s in shards], out / "tracks.parquet", TRACKS_SCHEMA)
    table = pa.Table.from_pandas(plan.conditions(), preserve_index=False)
    write_atomically(table, out / "conditions.parquet")


if __name__ == "__main__":
    stage_command("rollouts", produce, resume=True)
