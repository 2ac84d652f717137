"""From scored cases of joints to their rows of proof.csv."""

from collections.abc import Iterator

import pandas as pd

from slapshot.blind_validation.joints.score import ANSWERS
from slapshot.blind_validation.measures import Measure, median, share

ALL = "all"  # conditions of the list together
GEARED = "elasticity or backlash"


def measures_of(cases: pd.DataFrame) -> list[Measure]:
    """Shares and held-out errors by condition; times by what a diagnosis had to find.

    Args:
        cases: rows of `score`.
    """
    found: list[Measure] = []
    for condition, rows in cases.groupby("condition", sort=True):
        found += _of_condition(str(condition), rows)
    found.append(share("made_worse", ALL, cases["made_worse"]))
    for group, rows in cases.groupby("group", sort=True):
        found.append(median("cpu_s", f"{ALL}, {group}", rows["cpu_s"]))
    return found


def _of_condition(condition: str, rows: pd.DataFrame) -> Iterator[Measure]:
    for answer in ANSWERS:
        if rows[answer].notna().any():
            yield share(answer, condition, rows[answer].dropna())
    geared = rows["geared"].astype(bool)
    for name, part in ((condition, rows[~geared]), (f"{condition}, {GEARED}", rows[geared])):
        errors = part["held_out_over_floor"].dropna()
        if len(errors):
            yield median("held_out_over_floor", name, errors)
