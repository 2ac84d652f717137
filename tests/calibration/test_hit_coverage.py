"""Coverage of hits: recordings by the slide's own law, one effect's intervals, and the table made of them."""

import numpy as np
import pandas as pd
from slapshot.calibration import stage_hit_coverage_table, stage_hit_intervals
from slapshot.calibration.hit_coverage import intervals
from slapshot.calibration.slide_recordings import slide_recording
from slapshot.calibration.stage_hit_coverage_table import hit_coverage_aims
from slapshot.command import Run


def test_a_large_drag_is_held_by_an_interval_that_excludes_none():
    held = []
    for seed in range(4):
        (row,) = intervals("linear_drag", 7 + seed, 60)
        assert row["converged"]
        held.append(row["low"] <= row["truth"] <= row["high"])
        assert row["high"] - row["low"] < 0.6
    assert sum(held) >= 2  # of four that hold with 90 %, fewer in 0.4 % of draws


def test_yaw_is_recorded_for_what_follows_spin():
    """A curl that yaw tells: without it the sign of a spin is anyone's guess."""
    rows = list(intervals("curl", 3, 60))
    assert [row["parameter"] for row in rows] == ["strength", "log_spin"]
    assert rows[0]["high"] - rows[0]["low"] < 0.5
    plain = slide_recording(np.random.default_rng(0), 5)
    assert plain.tracks["yaw"].isna().all()
    seen = slide_recording(np.random.default_rng(0), 5, yaw_sd=0.02)
    assert seen.tracks["yaw"].notna().all()
    pd.testing.assert_series_equal(seen.tracks["x"], plain.tracks["x"])


def test_an_effect_that_is_missed_too_often_is_named():
    table = pd.DataFrame(
        {"effect": ["tilt", "tilt", "curl", "all"], "parameter": ["x", "y", "z", ""], "variant": "",
         "n": [10, 10, 10, 30], "held": [1.0, 0.8, 0.6, 0.8], "held_low": 0.6, "held_high": 0.9}
    )  # fmt: skip
    pooled, each = hit_coverage_aims(table)
    assert not pooled.reached
    assert not each.reached
    assert each.measured == "z of curl: 60.0 %"


def test_the_stages_write_blocks_and_the_page(tmp_path):
    block, out = tmp_path / "block", tmp_path / "out"
    block.mkdir()
    out.mkdir()
    own = {"effect": "linear_drag", "seed": 7, "hits": 20, "first": 0, "count": 2}
    stage_hit_intervals.produce(Run(own, {}, block, 1))
    stage_hit_coverage_table.produce(Run({"blocks": ["linear_drag/0"]}, {"linear_drag/0": block}, out, 1))
    assert {p.name for p in out.iterdir()} == {"hit_coverage.csv", "hit_coverage.md", "intervals.csv"}
    table = pd.read_csv(out / "hit_coverage.csv")
    assert table["effect"].tolist() == ["linear_drag", "all"]
    assert table["n"].tolist() == [2, 2]
