"""C5: the comparison of methods on recordings (paper, section "Physical experiments")."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.comparison import larger_on_rigs, mean_ratio, samples_to_reach
from slapshot.claims.statement import Statement, error_array
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "hockey, recorded: Kalman needs the fewest samples"

FEW = 8  # samples of the low-sample regime: Kalman's count in the paper
MATCHES = 0.1  # within 10 % of each other
WITHIN = 20  # samples after which the paper's MAML with 4 matches

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the errors of every method (role: method/recording), over all rigs and objects.

    Held against those in simulation (role: method), where they are given.
    """
    tables: dict[str, list[pd.DataFrame]] = {}
    simulated: dict[str, pd.DataFrame] = {}
    for role, folder in inputs.items():
        method, _, recording = role.partition("/")
        own = read_frame(folder / "errors.parquet")
        if recording:
            tables.setdefault(method, []).append(own.assign(recording=recording))
        else:
            simulated[method] = own
    errors = {method: pd.concat(parts, ignore_index=True) for method, parts in tables.items()}
    # Recordings can differ in their numbers of samples: as many as all of them have.
    most = min(table.groupby("recording")["samples"].max().min() for table in errors.values())
    errors = {method: table[table["samples"] <= most] for method, table in errors.items()}
    rigs = {m: error_array(table, ["recording", "rig"]) for m, table in errors.items()}
    count = next(iter(rigs.values())).shape[1]
    note = f"over {count} rigs, {'a stand-in each' if _stand_in(errors) else 'of which some are real'}"
    statements: list[Statement] = []
    if {"kalman", "lstm"} <= set(rigs):
        statements += _few_samples(rigs, note)
        if {"kalman", "lstm"} <= set(simulated):
            statements.append(larger_on_rigs(rigs, simulated, slice(1, FEW + 1), note))
        for name in sorted(errors["kalman"]["object"].unique()):
            statements.append(_per_object(errors, name, note))
    mamls = [m for m in rigs if m.startswith("maml_")]
    for method in (m for m in ("kalman", "lstm") if m in rigs):
        statements += [_ahead(rigs, method, maml, note) for maml in mamls]
    if {"kalman", "maml_4"} <= set(rigs):
        statements += _maml_4(rigs, note)
    if {"maml_1", "maml_8"} <= set(rigs):
        statements += _maml_1(rigs, note)
    return statements


def _stand_in(errors: Mapping[str, pd.DataFrame]) -> bool:
    return all(table["stand_in"].all() for table in errors.values())


def _curve(errors: Array) -> Array:
    return errors.mean((0, 1))


def _few_samples(rigs: Mapping[str, Array], note: str) -> list[Statement]:
    kalman, lstm = rigs["kalman"], rigs["lstm"]
    few, at = slice(1, FEW + 1), min(FEW, kalman.shape[2] - 1)

    def ratio(lstm: Array, kalman: Array) -> float:
        reached = _curve(kalman)[at]
        return min(samples_to_reach(_curve(lstm), reached), lstm.shape[2] - 1) / at

    return [
        Statement(
            text=f"LSTM needs more samples than Kalman for the error that Kalman has after {at}",
            measure=f"LSTM's samples over Kalman's {at}",
            interval=bootstrap(ratio, lstm, kalman),
            above=1,
            paper="12 / 8 = 1.5, for 14 cm",
            note=f"{note}; that error is {100 * _curve(kalman)[at]:.1f} cm here",
        ),
        Statement(
            text="Kalman is ahead of LSTM with few samples",
            measure=f"LSTM's error over Kalman's, mean over the first {FEW} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, few), lstm, kalman),
            above=1,
            paper="outperforms LSTM in the low-sample regime",
            note=note,
        ),
    ]


def _per_object(errors: Mapping[str, pd.DataFrame], name: str, note: str) -> Statement:
    few = slice(1, FEW + 1)
    lstm, kalman = (
        error_array(errors[m][errors[m]["object"] == name], ["recording", "rig"]) for m in ("lstm", "kalman")
    )
    return Statement(
        text=f"Kalman is ahead of LSTM with few samples on the {name} puck",
        measure=f"LSTM's error over Kalman's, mean over the first {FEW} samples",
        interval=bootstrap(lambda a, b: mean_ratio(a, b, few), lstm, kalman),
        above=1,
        paper="for both pucks",
        note=note,
    )


def _ahead(rigs: Mapping[str, Array], method: str, maml: str, note: str) -> Statement:
    few = slice(1, FEW + 1)
    batch, name = maml.rpartition("_")[2], {"kalman": "Kalman", "lstm": "LSTM"}[method]
    return Statement(
        text=f"With few samples {name} is ahead of MAML with {batch} an update",
        measure=f"MAML's error over its, mean over the first {FEW} samples",
        interval=bootstrap(lambda a, b: mean_ratio(a, b, few), rigs[maml], rigs[method]),
        above=1,
        paper="both recurrent methods outperform MAML in the low sample area",
        note=note,
    )


def _maml_4(rigs: Mapping[str, Array], note: str) -> list[Statement]:
    kalman, maml = rigs["kalman"], rigs["maml_4"]
    at = min(WITHIN, kalman.shape[2] - 1)
    return [
        Statement(
            text=f"MAML with 4 an update matches Kalman after about {WITHIN} samples",
            measure=f"its error over Kalman's after {at} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(at, at + 1)), maml, kalman),
            below=1 + MATCHES,
            paper="matches after about 20",
            note=f"{note}; matches: at most {100 * MATCHES:.0f} % more, a margin of our own",
        )
    ]


def _maml_1(rigs: Mapping[str, Array], note: str) -> list[Statement]:
    few = slice(1, FEW)
    one, eight = rigs["maml_1"], rigs["maml_8"]
    return [
        Statement(
            text="MAML with 1 an update is the better one at first",
            measure=f"its error over that of MAML with 8, mean over the first {FEW - 1} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, few), one, eight),
            below=1,
            paper="updating with one sample achieves the best performance at first",
            note=note,
        ),
        Statement(
            text="MAML with 1 an update converges to the larger error",
            measure=f"its error over that of MAML with 8 after {one.shape[2] - 1} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(-1, None)), one, eight),
            above=1,
            paper="but converges to a fairly large error",
            note=note,
        ),
    ]
