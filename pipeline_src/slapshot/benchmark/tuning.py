"""The same search of the learning rate for every method: short trainings, judged on validation conditions.

`snakemake tuning` runs it and writes figures/tuning.csv. config/default.yaml holds the best rate of each of
hockey's methods: the largest one tried, so that a better one may lie beyond. FetchSlide was not tuned. Test
conditions and recordings have no part in it.
"""

import argparse
from multiprocessing import get_context
from pathlib import Path

import pandas as pd
import torch

from slapshot.adaptation.train import train_ensemble
from slapshot.config.configuration import Configuration
from slapshot.config.domain import Domain
from slapshot.config.files import load_config
from slapshot.config.methods import EnsembleTraining
from slapshot.dag import load_plan
from slapshot.json_types import Row
from slapshot.store.folder import Store

RATES = (0.0005, 0.001, 0.002, 0.004)
STEPS = 600
MODELS = 2


def main() -> None:
    """Try every rate on every method of every domain."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.benchmark.tuning", description=__doc__)
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--config", type=Path)
    parser.add_argument("--store", type=Path, default=Path("data/store"))
    parser.add_argument("--out", type=Path, default=Path("figures/tuning.csv"))
    args = parser.parse_args()
    config, plan = load_config(args.config), load_plan(args.config)
    trials = []
    for name, domain in config.domains.items():
        recipe = plan.recipes[f"rollouts/{name}"]
        rollouts = Store(args.store).folder(recipe.stage, recipe.id)
        trials += [(name, domain, rollouts, m, rate) for m in domain.methods for rate in RATES]
    # One process per trial: in parallel on one thread each they finish sooner than in turn on all threads.
    with get_context("spawn").Pool(args.cores) as pool:
        table = pd.DataFrame(pool.map(_try, trials, chunksize=1))
    table.to_csv(args.out, index=False, float_format="%.6g")
    print(f"validation loss after {STEPS} steps by learning rate, mean of {MODELS} models")
    print(by_rate(table).assign(**{"in use": _in_use(config)}).to_string(float_format="%.4g"))


def by_rate(table: pd.DataFrame) -> pd.DataFrame:
    """Validation loss of each method (rows) by learning rate, and whether the best is at the grid's edge.

    Args:
        table: rows of tuning.csv.
    """
    shown = table.pivot(index=["domain", "method"], columns="learning_rate", values="validation_loss")
    edge = shown.idxmin(axis="columns").isin([shown.columns.min(), shown.columns.max()])
    return shown.assign(**{"best at the edge": edge.map({True: "yes", False: "no"})})


def _in_use(config: Configuration) -> pd.Series:
    rates = {
        (name, method): settings.learning_rate
        for name, domain in config.domains.items()
        for method, settings in domain.methods.items()
    }
    return pd.Series(rates)


def _try(trial: tuple[str, Domain, Path, str, float]) -> Row:
    """Train a small ensemble briefly; return its row of the table."""
    name, domain, rollouts, method, rate = trial
    torch.set_num_threads(1)
    short = EnsembleTraining.from_parts(
        domain.training, seed=domain.seed, models=MODELS, steps=STEPS, learning_rate=rate
    )
    own = domain.methods[method].own
    losses = train_ensemble(rollouts, method, own, short, torch.device("cpu"))[2]
    last = losses[losses["step"] == losses["step"].max()]["validation"]
    return {
        "domain": name,
        "method": method,
        "learning_rate": rate,
        "steps": STEPS,
        "validation_loss": last.mean(),
    }


if __name__ == "__main__":
    main()
