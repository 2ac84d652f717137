"""Comparison of arms in numbers: errors with intervals, noise floor, and the share of error removed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.recordings.format import Recording
from slapshot.retraining import ARMS

SAMPLES = 4  # number of adaptation samples at which arms are compared
DRAWS = 4000  # of the bootstrap


@dataclass(frozen=True)
class Measure:
    """A number with its 95 % interval.

    Attributes:
        measure, condition: name of the number, and the hits that it was measured on.
        value, low, high: NaN where they cannot be estimated.
        n: what the bootstrap resamples.
    """

    measure: str
    condition: str
    value: float
    low: float
    high: float
    n: int


def errors_by_arm(errors: Mapping[str, pd.DataFrame], samples: int) -> dict[str, Array]:
    """Arm -> mean distance (splits, models) in m after `samples` samples; a split is a repeat of an object.

    All arms use the same splits, so that their rows are paired.
    """
    found = {}
    for arm, table in errors.items():
        rows = table[table["samples"] == samples]
        found[arm] = rows.pivot_table(
            index=["rig", "object", "repeat"], columns="model", values="error_m"
        ).to_numpy(float)
    return found


def noise_floor(recording: Recording) -> tuple[float, int]:
    """Mean distance in m between repeats of a command and their mean, scaled to the recording's distances.

    Deviations are relative to the distance, corrected for the degree of freedom that the mean takes, and
    multiplied by the mean distance of all hits. The second value is the number of repeated hits; NaN and 0
    where no command was repeated.
    """
    hits = recording.hits[recording.hits["rest_x"].notna()]
    ends = hits[["rest_x", "rest_y"]].to_numpy(float)
    distance = np.linalg.norm(ends - hits[["start_x", "start_y"]].to_numpy(float), axis=1)
    shares = []
    groups = hits.assign(row=np.arange(len(hits))).dropna(subset="command_id")
    for _, group in groups.groupby(["object_id", "command_id"]):
        rows = group["row"].to_numpy()
        if len(rows) > 1:
            apart = np.linalg.norm(ends[rows] - ends[rows].mean(0), axis=1)
            shares.append(apart / distance[rows].mean() * np.sqrt(len(rows) / (len(rows) - 1)))
    if not shares:
        return float("nan"), 0
    return float(np.concatenate(shares).mean() * distance.mean()), len(np.concatenate(shares))


def measures_of(
    errors: Mapping[str, pd.DataFrame], floor: float, condition: str, rng: np.random.Generator
) -> list[Measure]:
    """Errors of each arm after SAMPLES hits (or all there are), and the share removed by the effects.

    Intervals are from a bootstrap over splits and models, with the same resamples for all arms.
    """
    seen = min(SAMPLES, int(min(table["samples"].max() for table in errors.values())))
    by_arm = errors_by_arm(errors, seen)
    splits, models = by_arm[ARMS[0]].shape
    draws = [np.ix_(rng.integers(0, splits, splits), rng.integers(0, models, models)) for _ in range(DRAWS)]

    def told(measure: str, of: Callable[[Mapping[str, Array]], float]) -> Measure:
        drawn = [of({arm: values[rows] for arm, values in by_arm.items()}) for rows in draws]
        low, high = np.percentile(drawn, [2.5, 97.5])
        return Measure(measure, condition, of(by_arm), float(low), float(high), splits)

    def error(arm: str) -> Callable[[Mapping[str, Array]], float]:
        return lambda part: float(part[arm].mean())

    def removed(part: Mapping[str, Array]) -> float:
        left = part["refitted"].mean() - floor
        return float((part["refitted"].mean() - part["augmented"].mean()) / left)

    found = [told(f"error_m, {arm}, {seen} samples", error(arm)) for arm in ARMS]
    return [*found, told("share above the noise floor that the effects remove", removed)]
