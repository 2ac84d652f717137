"""`snakemake benchmark`: measure, print, and write figures/benchmark.csv (measure, value, unit)."""

import argparse
import os
import sys
from pathlib import Path

import pandas as pd
import torch
from rich.console import Console
from rich.table import Table

from slapshot.benchmark.diagnosis import diagnosis_measures
from slapshot.benchmark.figures_run import figures_run, run_measures
from slapshot.benchmark.filter_peer import filter_measures, need_dynamax
from slapshot.benchmark.gallery import gallery_measures
from slapshot.benchmark.measures import (
    Measure,
    hit_measures,
    memory_measures,
    training_measures,
)
from slapshot.benchmark.peers import need_sysid, peer_measures
from slapshot.benchmark.scale import cluster_hours, configured_jobs, hours
from slapshot.benchmark.schedule import Job
from slapshot.config.files import load_config
from slapshot.config.methods import KalmanSettings
from slapshot.config.rollouts import RolloutsSettings
from slapshot.dag import make_plan
from slapshot.errors import InputError
from slapshot.scenes.scene import Scene
from slapshot.store.folder import Store
from slapshot.trajectories.swings import Swings
from slapshot.trajectories.vae import TrajectoryVae

PAPER = "paper"
SCALES = ("default", PAPER)


def measure(store: Store, cores: int) -> list[Measure]:
    """All measures: of each domain of the default configuration, of the gallery, diagnosis and peer tools."""
    need_sysid()
    need_dynamax()
    rows: list[Measure] = []
    configs = {name: load_config(Path(f"config/{name}.yaml")) for name in SCALES}
    plans = {name: make_plan(configs[name]) for name in SCALES}
    plan = plans["default"]
    try:
        rows += run_measures(figures_run(plan, store), cores)
    except InputError as error:  # the rest can be measured without
        print(f"benchmark: no figures_* rows: {error}", file=sys.stderr)
    at_paper_scale: list[dict[str, Job]] = []
    for domain, config in configs["default"].domains.items():
        inputs = store.inputs(plan.recipes[f"rollouts/{domain}"])
        folders = {**inputs, **store.inputs(plan.recipes[f"swings/{domain}"])}
        scene, swings = Scene.load(folders["scene"]), Swings.load(folders["swings"])
        model = TrajectoryVae.load(folders["trajectory_model"])
        settings = plan.recipes[f"rollouts/{domain}"].settings(RolloutsSettings)
        rows += hit_measures(domain, config, scene, model, swings)
        rows += memory_measures(domain, inputs, settings)
        torch.set_num_threads(1)  # as the stage does
        for name in SCALES:
            scale = configs[name].domains[domain]
            for method, own in scale.methods.items():
                action = scale.trajectory_model.latent
                timed = training_measures(domain, method, own.own, scale.training, action)
                if isinstance(own.own, KalmanSettings):
                    timed += filter_measures(domain, own.own, scale.training)
                rows += [Measure(f"{row.measure}_{name}", row.value, row.unit) for row in timed]
        measured = {row.measure: row.value for row in rows}
        for name in SCALES:
            scale = configs[name].domains[domain]
            jobs = configured_jobs(domain, name, scale, plans, folders, measured)
            rows += hours(domain, name, scale, jobs, cores)
            if name == PAPER:
                at_paper_scale.append(jobs)
    rows += cluster_hours(PAPER, at_paper_scale)
    viewer = plan.recipes["viewer/hockey"]
    rows += gallery_measures("hockey", store.folder(viewer.stage, viewer.id))
    rows += diagnosis_measures(configs["default"], store, cores)
    rows += peer_measures(configs["default"], store, cores)
    return rows


def main() -> None:
    """Command line that the workflow calls."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.benchmark")
    parser.add_argument("--store", type=Path, default=Path("data/store"))
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("figures/benchmark.csv"))
    args = parser.parse_args()
    try:
        rows = measure(Store(args.store), args.cores)
    except InputError as error:
        print(f"benchmark: {error}", file=sys.stderr)
        sys.exit(1)
    table = pd.DataFrame(rows)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    aside = args.out.with_suffix(".tmp")
    table.to_csv(aside, index=False, float_format="%.4g")
    aside.rename(args.out)
    shown = Table("measure", "value", "unit", box=None, pad_edge=False)
    for row in rows:
        shown.add_row(row.measure, f"{row.value:.4g}", "" if row.unit == "1" else row.unit)
    Console(width=110).print(shown)


if __name__ == "__main__":
    main()
