"""P-values of nulls: their table on p-values made by hand, and one for real."""

import numpy as np
import pandas as pd
import pytest
from slapshot.calibration import stage_null_p_values, stage_null_table
from slapshot.calibration.stage_null_p_values import noise_colour, null_p_value
from slapshot.calibration.stage_null_table import draw_nulls, null_aims, null_table
from slapshot.command import Run


def p_values(make, rigs=("pendulum", "arm"), n=500, cluttered=False):
    """Evenly spread probabilities through a quantile function, for each rig."""
    even = (np.arange(n) + 0.5) / n
    values = np.tile(make(even), len(rigs))
    return pd.DataFrame({"rig": np.repeat(rigs, n), "cluttered": cluttered, "p_value": values})


def test_uniform_p_values_reach_every_aim():
    table = null_table(p_values(lambda u: u))
    assert list(table["rig"]) == ["pendulum", "arm", "all"]
    assert list(table["n"]) == [500, 500, 1000]
    assert list(table["below_05"]) == pytest.approx([0.05] * 3)
    assert list(table["below_01"]) == pytest.approx([0.01] * 3)
    pooled = table.iloc[-1]
    assert pooled["below_05_low"] < 0.05 < pooled["below_05_high"]
    # Wilson's, of 50 in 1,000.
    assert pooled["below_05_low"] == pytest.approx(0.0381, abs=1e-4)
    assert pooled["below_05_high"] == pytest.approx(0.0653, abs=1e-4)
    assert all(aim.reached for aim in null_aims(table))


def test_p_values_by_draws_count_as_uniform():
    assert all(aim.reached for aim in null_aims(null_table(p_values(lambda u: np.ceil(500 * u) / 500))))


@pytest.mark.parametrize(
    ("make", "missed"),
    [
        (np.square, ["below 0.05", "below 0.01", "pendulum", "arm"]),  # too many small ones
        (lambda u: 1 - (1 - u) ** 2, ["below 0.05", "pendulum", "arm"]),  # too few
        (lambda u: np.where(u < 0.03, 1e-3, u), ["below 0.01"]),  # a heavy tail alone
    ],
)
def test_others_miss_what_they_should(make, missed):
    aims = null_aims(null_table(p_values(make)))
    found = [aim.of for aim in aims if not aim.reached]
    assert len(found) == len(missed)
    assert all(words in of for words, of in zip(missed, found, strict=True))


def test_one_rig_that_is_off_is_seen_beside_others():
    both = pd.concat([p_values(lambda u: u, ["arm"]), p_values(np.sqrt, ["kuka"])])
    off = [aim.of for aim in null_aims(null_table(both)) if not aim.reached and "Kolmogorov" in aim.of]
    assert off == ["Kolmogorov-Smirnov, kuka"]


@pytest.mark.parametrize(("make", "reached"), [(np.sqrt, True), (lambda u: u**3, False)])
def test_cluttered_ones_are_apart_and_judged_by_how_many_would_be_a_mismatch(make, reached):
    """Of cubes of uniform numbers 22 % lie below 0.01, and of square roots 0.01 %."""
    both = pd.concat([p_values(lambda u: u), p_values(make, ["shaky"], cluttered=True)])
    table = null_table(both)
    pooled = table.iloc[-1]
    assert (pooled["n"], pooled["below_05"], pooled["cluttered"]) == (1000, 0.05, False)
    aims = {aim.of: aim.reached for aim in null_aims(table)}
    assert aims.pop("share of p-values below 0.01, shaky") == reached
    assert all(aims.values())
    assert not any("Kolmogorov" in of and "shaky" in of for of in aims)


def test_the_figure_shows_every_p_value():
    drawing = draw_nulls(p_values(lambda u: u, n=50))
    assert len(drawing.table) == 100
    assert drawing.table.groupby("rig")["share"].max().tolist() == [1.0, 1.0]


def test_colours_take_turns():
    assert [noise_colour(k, ["ou20", "ou100"]) for k in range(4)] == ["ou20", "ou100"] * 2


@pytest.mark.parametrize("cluttered", [False, True])
def test_nulls_are_recorded_with_clutter_where_it_is_asked_for(monkeypatch, tmp_path, cluttered):
    asked = []

    def make_case(rig, kinds, seed, **condition):
        asked.append(condition["cluttered"])
        raise KeyboardInterrupt

    monkeypatch.setattr(stage_null_p_values, "make_case", make_case)
    config = {"name": "short", "rig": "pendulum", "noise": ["white"], "seed": 5, "first": 0, "count": 1,
              "episodes": 5, "seconds": 0.5, "cluttered": cluttered}  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        stage_null_p_values.produce(Run(config, {}, tmp_path, 1))
    assert asked == [cluttered]


def test_a_null_for_real(tmp_path):
    (tmp_path / "block").mkdir()
    config = {"name": "short", "rig": "pendulum", "noise": ["white"], "seed": 5, "first": 1, "count": 1,
              "episodes": 5, "seconds": 0.5}  # fmt: skip
    stage_null_p_values.produce(Run(config, {}, tmp_path / "block", 1))
    written = pd.read_csv(tmp_path / "block/p_values.csv")
    assert written.iloc[0].to_dict() == {
        "rig": "short", "noise": "white", "cluttered": False, "seed": 6,
        "p_value": pytest.approx(null_p_value("pendulum", "white", 6, 5, 0.5), rel=1e-8),
    }  # fmt: skip
    assert 0 < written["p_value"][0] <= 1
    (tmp_path / "table").mkdir()
    stage_null_table.produce(
        Run({"blocks": ["short/1"]}, {"short/1": tmp_path / "block"}, tmp_path / "table", 1)
    )
    names = {file.name for file in (tmp_path / "table").iterdir()}
    assert {f"joint_nulls.{kind}" for kind in ("csv", "md", "png", "pdf")} < names
    assert "Kolmogorov-Smirnov, short | above 0.001" in (tmp_path / "table/joint_nulls.md").read_text()
