"""Errors of two methods compared: ratios of mean errors, and how many samples an error takes."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.statement import Statement, error_array
from slapshot.statistics import bootstrap

Array = NDArray[np.floating]

_METHODS = ("lstm", "kalman")


def samples_to_reach(curve: Array, error: float) -> float:
    """Samples after which a curve (samples + 1) has come down to `error`, linear in between; inf if never."""
    below = np.flatnonzero(curve <= error)
    if len(below) == 0:
        return np.inf
    n = below[0]
    if n == 0:
        return 0.0
    return float(n - 1 + (curve[n - 1] - error) / (curve[n - 1] - curve[n]))


def samples_needed(curves: Array, reached: Array, samples: Array) -> float:
    """Samples after which the mean of curves (models, tasks, n) has come down to that of `reached`.

    Args:
        curves: errors.
        reached: errors of any shape.
        samples: (n,) whole numbers that the curves were measured after, from 0; straight lines in between.

    Returns:
        The largest of them where the mean never gets there.
    """
    mean = np.interp(np.arange(samples[-1] + 1), samples, curves.mean((0, 1)))
    return min(samples_to_reach(mean, float(reached.mean())), float(samples[-1]))


def mean_ratio(first: Array, second: Array, samples: slice) -> float:
    """Mean error of the first over that of the second, each (models, tasks, samples + 1)."""
    return float(first[:, :, samples].mean() / second[:, :, samples].mean())


def drawn_errors(table: pd.DataFrame) -> Array:
    """(models, conditions, samples + 1) of the conditions that were drawn; named ones are left out."""
    return error_array(table[table["name"] == ""], "condition")


def grows_with_noise(errors: Mapping[str, pd.DataFrame], few: slice) -> list[Statement]:
    """Whether the lead is larger with the most noise than with the least.

    Args:
        errors: of Kalman and LSTM on the same test conditions, as `evaluate` writes them.
        few: samples that count as few.

    Returns:
        One statement; none where there is but one level of noise.
    """
    levels = sorted(errors["kalman"]["noise_variance"].unique())
    if len(levels) < 2:
        return []
    tables = {m: errors[m].groupby("noise_variance") for m in _METHODS}
    pairs = [[drawn_errors(tables[m].get_group(level)) for m in _METHODS] for level in levels]
    interval = bootstrap(
        lambda a, b, c, d: mean_ratio(a, b, few) / mean_ratio(c, d, few), *pairs[-1], *pairs[0]
    )
    ratios = ", ".join(f"{mean_ratio(lstm, kalman, few):.3f}" for lstm, kalman in pairs)
    shrinks = "the lead shrinks with noise: " * (interval.high < 1)
    return [
        Statement(
            text="With few samples Kalman's lead over LSTM grows with noise",
            measure=(
                f"LSTM's error over Kalman's, mean over samples {few.start} to {few.stop - 1}: at noise "
                f"variance {levels[-1]:g} over that at {levels[0]:g}"
            ),
            interval=interval,
            above=1,
            paper="outperforms the baseline most notably in the low-sample regime and high noise conditions",
            note=f"{shrinks}the ratio is {ratios} at noise variance {', '.join(f'{v:g}' for v in levels)}",
        )
    ]


def larger_on_rigs(
    rigs: Mapping[str, Array], simulated: Mapping[str, pd.DataFrame], few: slice, note: str
) -> Statement:
    """Whether the lead is larger on recorded rigs than in simulation.

    Args:
        rigs: errors of Kalman and LSTM (models, rigs, samples + 1).
        simulated: of the same models on test conditions, as `evaluate` writes them.
        few: samples that count as few.
        note: which rigs they are.
    """
    recorded = [rigs[m] for m in _METHODS]
    drawn = [drawn_errors(simulated[m]) for m in _METHODS]
    on_rigs, in_simulation = (mean_ratio(lstm, kalman, few) for lstm, kalman in (recorded, drawn))
    return Statement(
        text="With few samples Kalman's lead over LSTM is larger on recorded rigs than in simulation",
        measure=(
            f"LSTM's error over Kalman's, mean over samples {few.start} to {few.stop - 1}: on recorded rigs "
            "over that in simulation"
        ),
        interval=bootstrap(
            lambda a, b, c, d: mean_ratio(a, b, few) / mean_ratio(c, d, few),
            *recorded,
            *drawn,
            tasks=(0, 0, 1, 1),
        ),
        above=1,
        paper="no significant change in simulation; on the robot Kalman is ahead in the low-sample regime",
        note=(
            f"the ratio is {on_rigs:.3f} {note}, and {in_simulation:.3f} over {drawn[0].shape[1]} "
            "simulated conditions with all levels of noise"
        ),
    )
