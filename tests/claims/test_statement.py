import math

import numpy as np
import pandas as pd
import pytest
from slapshot.claims.statement import Statement, error_array
from slapshot.statistics import Interval


def verdict(low: float, high: float, above: float = -math.inf, below: float = math.inf) -> str:
    interval = Interval((low + high) / 2, low, high)
    return Statement("text", "measure", interval, above=above, below=below).verdict


@pytest.mark.parametrize(
    ("low", "high", "above", "below", "expected"),
    [
        (1.1, 1.2, 1, math.inf, "holds"),
        (0.8, 0.9, 1, math.inf, "does not hold"),
        (0.9, 1.1, 1, math.inf, "undecided"),
        (0.8, 0.9, -math.inf, 1, "holds"),
        (1.1, 1.2, -math.inf, 1, "does not hold"),
        (0.9, 1.1, -math.inf, 1, "undecided"),
        # Between two limits.
        (0.95, 1.05, 0.9, 1.1, "holds"),
        (0.7, 0.8, 0.9, 1.1, "does not hold"),
        (1.2, 1.3, 0.9, 1.1, "does not hold"),
        (0.85, 1.05, 0.9, 1.1, "undecided"),
        (0.95, 1.2, 0.9, 1.1, "undecided"),
        (0.8, 1.2, 0.9, 1.1, "undecided"),
        # On a limit: equal is not above, and not below either.
        (1.0, 1.2, 1, math.inf, "undecided"),
        (0.8, 1.0, 1, math.inf, "undecided"),
        (1.0, 1.0, 1, math.inf, "undecided"),
        # What cannot be computed decides nothing.
        (math.nan, math.nan, 1, math.inf, "undecided"),
        (math.inf, math.inf, 1, math.inf, "holds"),
    ],
)
def test_the_whole_interval_must_say_so(low, high, above, below, expected):
    assert verdict(low, high, above, below) == expected


def test_a_row_has_everything_that_is_shown():
    statement = Statement("t", "m", Interval(2.0, 1.0, 3.0), above=0.5, unit="cm", scale=100, paper="p")
    expected = {
        "text": "t", "measure": "m", "value": 2.0, "low": 1.0, "high": 3.0, "above": 0.5, "below": math.inf,
        "unit": "cm", "scale": 100, "paper": "p", "verdict": "holds", "note": "",
    }  # fmt: skip
    assert statement.row() == expected


def test_errors_are_ordered_by_model_task_and_samples_and_averaged_over_the_rest():
    keys = [
        (m, rig, name, r, n)
        for m in (1, 0)
        for rig in (2, 0)
        for name in "ab"
        for r in (0, 1)
        for n in (1, 0)
    ]
    table = pd.DataFrame(keys, columns=["model", "rig", "recording", "repeat", "samples"])
    number = table["recording"].map({"a": 0, "b": 1})
    table["error_m"] = 1000 * table["model"] + 100 * number + 10 * table["rig"] + table["samples"]
    table["error_m"] += np.where(table["repeat"] == 0, 0.4, -0.4)
    found = error_array(table, ["recording", "rig"])
    assert found.shape == (2, 4, 2)
    expected = [[[1000 * m + task + n for n in (0, 1)] for task in (0, 20, 100, 120)] for m in (0, 1)]
    assert found == pytest.approx(np.array(expected, float))
    assert error_array(table, "rig")[1, :, 0] == pytest.approx([1050.0, 1070.0])
