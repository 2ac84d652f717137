"""C4: the comparison of methods in simulation (paper, section "Hockeypuck simulation experiments")."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.comparison import drawn_errors, grows_with_noise, mean_ratio
from slapshot.claims.statement import Statement, error_array
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "hockey, simulated: Kalman and LSTM alike, both ahead of MAML"

EQUIVALENCE_MARGIN = 0.1  # equivalence margin: errors within 10 % of each other
NEAR = 1.5  # "near but behind": at most half as much error again
FEW = 4  # samples: fewer than the larger of MAML's batches, which has not moved yet
LOW_SAMPLES = 8  # the low-sample regime of figure 7
FRICTIONS = ("low friction", "medium friction", "high friction")  # named conditions

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From the errors of every method (role: method) on the same test conditions."""
    errors = {method: read_frame(folder / "errors.parquet") for method, folder in inputs.items()}
    drawn = {m: drawn_errors(table) for m, table in errors.items()}
    mamls = sorted((m for m in drawn if re.fullmatch(r"maml_\d+", m)), key=batch)
    statements = []
    if {"kalman", "lstm"} <= set(drawn):
        statements.append(_equivalent(drawn))
        statements += grows_with_noise(errors, slice(1, LOW_SAMPLES + 1))
    for method in (m for m in ("kalman", "lstm") if m in drawn):
        statements += [_behind(drawn, method, maml) for maml in mamls]
    if len(mamls) > 1 and "kalman" in drawn:
        statements += _by_batch(drawn, mamls[0], mamls[-1])
        statements.append(_noise_penalty(errors, mamls[0], mamls[-1]))
    for method in (m for m in ("kalman", "lstm") if m in errors):
        if set(FRICTIONS) <= set(errors[method]["name"]):
            statements.append(_low_friction(errors[method], method))
    return statements


def batch(method: str) -> int:
    """Samples an update, from a name such as maml_8."""
    return int(method.rpartition("_")[2])


def _equivalent(errors: Mapping[str, Array]) -> Statement:
    return Statement(
        text="Kalman and LSTM perform alike",
        measure="LSTM's error over Kalman's, mean over all samples from the first on",
        interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(1, None)), errors["lstm"], errors["kalman"]),
        above=1 - EQUIVALENCE_MARGIN,
        below=1 + EQUIVALENCE_MARGIN,
        paper="no significant change, Kalman slightly better",
        note=f"alike: within {100 * EQUIVALENCE_MARGIN:.0f} %, a margin of our own",
    )


def _behind(errors: Mapping[str, Array], method: str, maml: str) -> Statement:
    return Statement(
        text=f"{_name(method)} beats MAML with {_samples(maml)} an update",
        measure="MAML's error over its, mean over all samples from the first on",
        interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(1, None)), errors[maml], errors[method]),
        above=1,
        paper="outperform MAML",
    )


def _by_batch(errors: Mapping[str, Array], small: str, large: str) -> list[Statement]:
    kalman, first, last = errors["kalman"], errors[small], errors[large]
    few = slice(1, FEW + 1)
    return [
        Statement(
            text=f"MAML with {_samples(small)} an update starts faster than with {_samples(large)}",
            measure=f"its error over the other's, mean over the first {FEW} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, few), first, last),
            below=1,
            paper="comparable performance improvements at first",
        ),
        Statement(
            text=f"MAML with {_samples(small)} an update stays above 20 cm",
            measure=f"its error after {first.shape[2] - 1} samples",
            interval=bootstrap(lambda a: float(a[:, :, -1].mean()), first),
            above=0.2,
            unit="cm",
            scale=100,
            paper="converges to over 20 cm",
            note=(
                f"before any sample the error is {100 * first[:, :, 0].mean():.1f} cm here; centimetres "
                "depend on how hard pucks are hit"
            ),
        ),
        Statement(
            text=f"MAML with {_samples(small)} an update ends at a larger error than with {_samples(large)}",
            measure=f"its error over the other's after {first.shape[2] - 1} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(-1, None)), first, last),
            above=1,
            paper="due to noise converges to a large error",
        ),
        Statement(
            text=f"MAML with {_samples(large)} an update ends near the recurrent methods, but behind",
            measure=f"its error over Kalman's after {first.shape[2] - 1} samples",
            interval=bootstrap(lambda a, b: mean_ratio(a, b, slice(-1, None)), last, kalman),
            above=1,
            below=NEAR,
            paper="comparable, but slightly worse",
            note=f"near: at most {NEAR:g} times the error, a margin of our own",
        ),
    ]


def _noise_penalty(errors: Mapping[str, pd.DataFrame], small: str, large: str) -> Statement:
    parts = []
    for method in (small, large):
        table = errors[method]
        levels = sorted(table["noise_variance"].unique())
        parts += [drawn_errors(table[table["noise_variance"] == v]) for v in (levels[-1], levels[0])]

    def difference(noisy_a: Array, clean_a: Array, noisy_b: Array, clean_b: Array) -> float:
        last = slice(-1, None)
        return mean_ratio(noisy_a, clean_a, last) - mean_ratio(noisy_b, clean_b, last)

    return Statement(
        text="Noise costs MAML more when its batches are small",
        measure=(
            f"error with the most noise over error without, after the last sample: {_samples(small)} "
            f"an update less {_samples(large)}"
        ),
        interval=bootstrap(difference, *parts),
        above=0,
        paper="the difference is more pronounced when the update batch size is small",
    )


def _low_friction(errors: pd.DataFrame, method: str) -> Statement:
    low, medium, high = (error_array(errors[errors["name"] == name], "repeat") for name in FRICTIONS)
    few = slice(1, LOW_SAMPLES + 1)

    def ratio(a: Array, b: Array, c: Array) -> float:
        return float(a[:, :, few].mean() / max(b[:, :, few].mean(), c[:, :, few].mean()))

    return Statement(
        text=f"{_name(method)}'s error is largest where friction is low",
        measure=(
            f"its error at low friction over the larger of those at medium and high, mean over the first "
            f"{LOW_SAMPLES} samples"
        ),
        interval=bootstrap(ratio, low, medium, high),
        above=1,
        paper="the adaptation error is the highest in the low friction case",
        note="three single conditions; the interval is over models and random splits of their hits",
    )


def _name(method: str) -> str:
    return {"kalman": "Kalman", "lstm": "LSTM"}[method]


def _samples(maml: str) -> str:
    return "1 sample" if batch(maml) == 1 else f"{batch(maml)} samples"
