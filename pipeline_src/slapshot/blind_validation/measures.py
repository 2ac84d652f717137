"""From scored cases to the rows of proof.csv: measure, condition, value with its 95 % interval, and n."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from slapshot.statistics import wilson_interval

DRAWS = 4000
ALL = "all"  # conditions together
SURE = 0.9  # stated probability of a name


@dataclass(frozen=True)
class Measure:
    """A number over the cases of a condition, with a 95 % interval.

    Attributes:
        measure, condition: what and of which cases.
        value, low, high: NaN where there are no cases.
        n: cases, or intervals where those are counted.
    """

    measure: str
    condition: str
    value: float
    low: float
    high: float
    n: int


# Measure -> column of a yes or no.
SHARES = {
    "naming_top1": "top1",
    "naming_top1_drags_merged": "top1_merged",
    "in_class": "in_class",
    "both_named": "both",
    "both_in_class": "both_in_class",
    "one_named": "one",
    "phase_right": "phase_right",
    "variable_right": "variable_right",
    "detected": "found",
}
RATIOS = {
    "track_error": "track_rmse_m",
    "rest_error": "rest_rmse_m",
    "rest_error_from_command": "command_rest_rmse_m",
}


def measures_of(cases: pd.DataFrame) -> list[Measure]:
    """All measures, condition after condition."""
    found: list[Measure] = []
    for condition, rows in cases.groupby("condition", sort=True):
        found += _of_condition(str(condition), rows)
    return [*found, *_of_all(cases)]


def _of_all(cases: pd.DataFrame) -> Iterator[Measure]:
    """Of all cases together: names that did harm, and sure ones that were wrong."""
    if "made_worse" in cases and cases["made_worse"].notna().any():
        yield share("made_worse", ALL, cases["made_worse"].dropna())
    if "stated_probability" in cases and "top1" in cases:
        sure = cases[cases["stated_probability"].astype(float) > SURE]
        if len(sure):
            # Where nothing or something uncatalogued is concealed, no name is right.
            yield share("sure_and_wrong", ALL, ~sure["top1"].astype("boolean").fillna(False).astype(bool))


def _of_condition(condition: str, rows: pd.DataFrame) -> Iterator[Measure]:
    yield share("cannot_tell", condition, rows["cannot_tell"].fillna("") != "")
    null = (rows["conceals"].fillna("") == "").all()
    if null:
        yield share("false_alarm", condition, rows["found"])
        p_values = rows["p_value"].dropna().astype(float)
        if len(p_values):
            yield share("p_below_05", condition, p_values < 0.05)
    else:
        for measure, column in SHARES.items():
            if column in rows and rows[column].notna().any():
                yield share(measure, condition, rows[column].dropna())
        known = condition.split(",")[0] != "uncatalogued"
        unknown = rows["unknown"].astype("boolean").fillna(False).astype(bool)
        if known:
            yield share("false_unknown", condition, unknown)
            yield median("class_size", condition, rows["class_size"].dropna())
        else:
            # Found, and explained by no name.
            nameless = rows["found"].astype(bool) & (rows["named"].fillna("") == "")
            yield share("unknown_flagged", condition, unknown | nameless)
    if "intervals" in rows and rows["intervals"].sum() > 0:
        yield clustered("coverage90", condition, rows["intervals_held"], rows["intervals"])
    for measure, column in RATIOS.items():
        floor = rows[f"noise_floor_{column}"].astype(float)
        for scene in ("nominal", "refitted"):
            ratio = rows[f"augmented_{column}"].astype(float) / rows[f"{scene}_{column}"].astype(float)
            yield median(f"{measure}_over_{scene}", condition, ratio.dropna())
        yield median(
            f"{measure}_over_floor", condition, (rows[f"augmented_{column}"].astype(float) / floor).dropna()
        )
    yield median("chi2_per_freedom", condition, rows["augmented_chi2_per_freedom"].dropna().astype(float))
    if "gain_share" in rows:
        yield median("gain_over_true_family", condition, rows["gain_share"].dropna().astype(float))


def share(measure: str, condition: str, yes: pd.Series) -> Measure:
    """With Wilson's interval."""
    values = yes.astype(bool)
    interval = wilson_interval(int(values.sum()), len(values))
    return Measure(measure, condition, interval.value, interval.low, interval.high, len(values))


def median(measure: str, condition: str, values: pd.Series) -> Measure:
    """With a bootstrap over cases."""
    numbers = values.to_numpy(float)
    if not len(numbers):
        return Measure(measure, condition, np.nan, np.nan, np.nan, 0)
    rng = np.random.default_rng(0)
    draws = np.median(numbers[rng.integers(0, len(numbers), (DRAWS, len(numbers)))], axis=1)
    low, high = np.percentile(draws, [2.5, 97.5])
    return Measure(measure, condition, float(np.median(numbers)), float(low), float(high), len(numbers))


def clustered(measure: str, condition: str, held: pd.Series, number: pd.Series) -> Measure:
    """Share of all intervals, with a bootstrap over cases, whose intervals are correlated."""
    top, bottom = held.fillna(0).to_numpy(float), number.fillna(0).to_numpy(float)
    some = bottom > 0
    top, bottom = top[some], bottom[some]
    rng = np.random.default_rng(0)
    rows = rng.integers(0, len(top), (DRAWS, len(top)))
    low, high = np.percentile(top[rows].sum(1) / bottom[rows].sum(1), [2.5, 97.5])
    return Measure(
        measure, condition, float(top.sum() / bottom.sum()), float(low), float(high), int(bottom.sum())
    )
