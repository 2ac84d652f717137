"""S11: ranges of randomisation from beliefs about recordings, which the paper proposes and does not do."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.claims.comparison import samples_needed
from slapshot.claims.statement import Statement, error_array
from slapshot.parquet import read_frame
from slapshot.statistics import bootstrap

TITLE = "hockey, recorded: beliefs narrow the ranges of randomisation"

NOMINAL = 0.9  # of 5 to 95 % ranges
FEW, TARGET_RATIO = 2, 0.75
SEEN = 8
MIN_COVERAGE = 0.8  # coverage from which on ranges may be used, a margin of our own
_NAMES = {
    "friction_x": "friction along x",
    "friction_y": "the ratio of frictions",
    "mass": "mass",
    "friction_torsional": "torsional friction",
}

Array = NDArray[np.floating]


def evaluate(inputs: Mapping[str, Path]) -> list[Statement]:
    """From ranges and truths of all rigs (role: coverage), and errors of models made again (role: rig)."""
    table = read_frame(inputs["coverage"] / "coverage.parquet")
    statements = []
    for parameter, name in _NAMES.items():
        every = table[table["parameter"] == parameter]
        own = every[every["drawable"]]
        if own.empty:
            continue
        beyond = len(every) - len(own)
        counted = f"{int(own['inside'].sum())} of {len(own)} rigs and pucks"
        counted += f", without {beyond} whose truth training cannot draw" * (beyond > 0)
        by_rig = own.assign(width=(own["high"] - own["low"]) / (own["prior_high"] - own["prior_low"]))
        rigs = by_rig.groupby("rig")[["inside", "width"]].mean().astype(float)
        off = (own["median"] / own["truth"]).median()
        statements.append(
            Statement(
                text=f"Refined ranges of {name} hold the truth",
                measure=f"share of rigs and pucks whose 5 to 95 % range does; nominal {NOMINAL:g}",
                interval=bootstrap(lambda a: float(a.mean()), rigs["inside"].to_numpy()[None]),
                above=MIN_COVERAGE,
                paper="a range of randomization parameters that encapsulate the real conditions",
                note=(
                    f"{counted}; ranges are {100 * rigs['width'].median():.0f} % as wide as those of "
                    f"training in the median, their middle is {off:.2f} times the truth; {len(rigs)} "
                    "stand-in rigs, whose "
                    "blade bends and whose board is uneven: what training lacks is taken for another "
                    "friction or mass"
                ),
            )
        )
    simulated = read_frame(inputs["coverage"] / "simulated.parquet")
    statements.append(_in_simulation(simulated))
    refined = [read_frame(f / "errors.parquet") for role, f in inputs.items() if role != "coverage"]
    if not refined:
        return statements
    errors = pd.concat(refined, ignore_index=True)
    return [*statements, _fewer_centimetres(errors), _fewer_samples(errors)]


def _in_simulation(table: pd.DataFrame) -> Statement:
    """Where training lacks nothing: whether the method itself is right.

    Rolling friction is left out: it moves no rest point, so that its range is the prior's own 5 to 95 %.
    """
    names = _NAMES | {"noise_variance": "the level of noise"}
    table = table[table["parameter"].isin(list(names))]
    inside = table.groupby("condition")["inside"].mean().to_numpy(float)
    shares = 100 * table.groupby("parameter", sort=False)["inside"].mean()
    each = ", ".join(f"{names[str(name)]} {share:.0f} %" for name, share in shares.items())
    return Statement(
        text="In simulation, refined ranges hold the truth",
        measure=f"share of conditions and parameters whose 5 to 95 % range does; nominal {NOMINAL:g}",
        interval=bootstrap(lambda a: float(a.mean()), inside[None]),
        above=MIN_COVERAGE,
        note=f"{len(inside)} validation conditions; {each}",
    )


def _fewer_centimetres(errors: pd.DataFrame) -> Statement:
    """Of models trained again; a task is one split of a puck's new hits."""
    before, after = (curves[:, :, [FEW]] for curves in _arms(errors))
    rigs = errors["rig"].nunique()
    return Statement(
        text=f"Models of refined ranges err by at most three quarters as much after {FEW} samples",
        measure="their error over that of models of all ranges",
        interval=bootstrap(lambda a, b: float(b.mean() / a.mean()), before, after),
        below=TARGET_RATIO,
        paper="could be used to train a model which achieves even smaller error in the low sample regime",
        note=(
            f"{100 * before.mean():.1f} cm before, {100 * after.mean():.1f} cm with refined ranges; new "
            f"hits of {rigs} stand-in rig{'s' * (rigs > 1)}; the interval is over models and splits of hits"
        ),
    )


def _fewer_samples(errors: pd.DataFrame) -> Statement:
    before, after = _arms(errors)
    at = min(SEEN, before.shape[2] - 1)
    samples = np.arange(after.shape[2], dtype=float)
    return Statement(
        text=f"Models of refined ranges need fewer samples for the error that the others have after {at}",
        measure=f"samples that they need over {at}",
        interval=bootstrap(lambda a, b: samples_needed(b, a[:, :, at], samples) / at, before, after),
        below=1,
        paper="an even smaller error in the low sample regime",
        note=f"that error is {100 * before[:, :, at].mean():.1f} cm; intervals as above",
    )


def _arms(errors: pd.DataFrame) -> tuple[Array, Array]:
    """(models, tasks, samples + 1) of all ranges and of refined ones; a task is a split of a puck's hits."""
    task = ["rig", "object", "repeat"]
    before, after = (
        error_array(errors[errors["arm"] == arm], task) for arm in ("all ranges", "refined ranges")
    )
    return before, after
