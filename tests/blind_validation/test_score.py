"""Scores and measures of cases whose answer is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from slapshot.blind_validation.measures import clustered, measures_of, median, share
from slapshot.diagnosis.pucks.verdict import Interval

from .conftest import ERRORS, concealed, effect, verdict


def test_a_right_name_with_an_interval_that_holds(scored):
    tilt = effect("tilt", slope_x=(0.01, 0.009, 0.011), slope_y=(0.0, 0.001, 0.002))
    row = scored("plain", [concealed("tilt", slope_x=0.0105, slope_y=0.0)], verdict(tilt))
    assert row["condition"] == "plain"
    assert row["top1"]
    assert row["in_class"]
    assert row["phase_right"]
    assert (row["intervals"], row["intervals_held"]) == (2, 1)


def test_a_law_of_drag_named_for_another_counts_where_they_are_merged(scored):
    answer = verdict(effect("quadratic_drag", {"quadratic_drag": 0.8, "linear_drag": 0.2}))
    row = scored("plain", [concealed("linear_drag")], answer)
    assert not row["top1"]
    assert row["top1_merged"]
    assert row["in_class"]
    other = scored("plain", [concealed("tilt")], answer)
    assert not other["top1_merged"]
    assert not other["in_class"]


def test_pairs_count_both_and_one(scored):
    truths = [concealed("tilt"), concealed("curl")]
    assert scored("pairs", truths, verdict(effect("curl"), effect("tilt")))["both"]
    one = scored("pairs", truths, verdict(effect("curl"), effect("linear_drag")))
    assert not one["both"]
    assert one["one"]
    assert not scored("pairs", truths, verdict(effect("linear_drag")))["one"]


def test_what_cannot_be_plain_is_scored_by_its_size(scored):
    answer = verdict()
    assert scored("plain", [concealed("curl", 0.3)], answer)["condition"] == "weak"
    assert (
        scored("launch", [concealed("blade_friction", 0.06, "contact")], answer)["condition"]
        == "launch, faint"
    )
    assert scored("weak", [concealed("tilt", 0.3)], answer)["condition"] == "weak"


def test_uncatalogued_physics_is_scored_by_place_and_not_by_name(scored):
    row = scored("uncatalogued", [concealed("tether", catalogued=False)], verdict(unknown=True))
    assert row["unknown"]
    assert row["phase_right"]
    assert "top1" not in row


def test_measures_are_shares_of_their_condition(scored):
    tilt, curl = [concealed("tilt", slope_x=0.01)], [concealed("curl")]
    right = verdict(effect("tilt", slope_x=(0.01, 0.009, 0.011)))
    rows = [scored("plain", tilt, right)] * 3 + [scored("plain", curl, right)]
    rows += [scored("null", [], verdict())] * 9 + [scored("null", [], right)]
    table = {(m.measure, m.condition): m for m in measures_of(pd.DataFrame(rows))}
    assert table["naming_top1", "plain"].value == 0.75
    assert table["naming_top1", "plain"].n == 4
    assert table["false_alarm", "null"].value == 0.1
    assert table["false_alarm", "null"].low < 0.1 < table["false_alarm", "null"].high
    assert table["track_error_over_floor", "plain"].value == 1.0
    assert table["coverage90", "plain"].value == 1.0
    assert ("naming_top1", "null") not in table


def test_names_that_do_harm_and_sure_ones_that_are_wrong_are_counted(scored):
    harmful = verdict(effect("curl"))
    worse = replace(ERRORS, rest_rmse_m=Interval(0.021, 0.02, 0.022))
    harmful = replace(harmful, fit=harmful.fit | {"augmented": worse})
    unsure = verdict(effect("curl", {"curl": 0.6, "tilt": 0.4}))
    rows = [
        scored("plain", [concealed("tilt")], harmful),
        scored("plain", [concealed("tilt")], unsure),
        scored("plain", [concealed("curl")], verdict(effect("curl"))),
        scored("null", [], verdict()),
    ]
    table = {(m.measure, m.condition): m for m in measures_of(pd.DataFrame(rows))}
    assert (table["made_worse", "all"].value, table["made_worse", "all"].n) == (0.25, 4)
    assert (table["sure_and_wrong", "all"].value, table["sure_and_wrong", "all"].n) == (0.5, 2)
    assert table["p_below_05", "null"].value == 1.0
    assert table["cannot_tell", "plain"].value == 0.0


def test_intervals_are_wilsons():
    # By hand for 0 of 200: z^2 / (n + z^2), z = 1.96.
    found = share("m", "c", pd.Series([False] * 200))
    assert found.low == pytest.approx(0, abs=1e-12)
    assert found.high == pytest.approx(1.96**2 / (200 + 1.96**2), rel=1e-3)


def test_the_bootstrap_of_a_median_narrows_with_the_cases():
    rng = np.random.default_rng(1)
    few, many = (median("m", "c", pd.Series(rng.normal(size=n))) for n in (20, 2000))
    assert many.high - many.low < 0.2 * (few.high - few.low)
    assert few.low <= few.value <= few.high


def test_intervals_of_one_case_go_together():
    held, number = pd.Series([2, 0, 2, 2]), pd.Series([2, 2, 2, 2])
    found = clustered("coverage90", "c", held, number)
    assert found.value == 0.75
    assert found.n == 8
    assert found.low <= 0.5  # one of four cases is all wrong


def test_what_cannot_be_told_is_a_miss(scored):
    untold = replace(
        verdict(), cannot_tell="too few hits", mismatch=None, location=None, unknown=None, fit=None
    )
    row = scored("plain", [concealed("tilt")], untold)
    assert (row["found"], row["top1"], row["in_class"], row["phase_right"]) == (False, False, False, False)
    assert row["both"] is None
    null = scored("null", [], untold)
    assert null["found"] is False
    assert "top1" not in null
