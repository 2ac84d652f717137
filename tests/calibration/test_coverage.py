"""Coverage: its table on intervals made by hand, rigs by themselves, and one fit for real."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from slapshot.calibration import stage_coverage_table, stage_law_intervals
from slapshot.calibration.calibration_rigs import INTERVAL, Motion, calibration_rig, simulate_recording
from slapshot.calibration.coverage import (
    RIGS,
    CalibratedEffect,
    calibrated_effects,
    draw_from_prior,
    intervals,
)
from slapshot.calibration.stage_coverage_table import coverage_aims, coverage_table
from slapshot.command import Run
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection import structural_search
from slapshot.diagnosis.selection.problem import Problem
from slapshot.effects.joints.effect import JointEffect, Parameter
from slapshot.effects.joints.linear_drag import LinearDrag


def made(held: int, n: int = 100, *, parameter: str = "torque", failed: int = 0) -> pd.DataFrame:
    """Intervals of which so many hold the truth, 2; the first so many did not converge."""
    high = np.where(np.arange(n) < held, 2.5, 1.9)
    return pd.DataFrame(
        {"effect": "spring", "variant": "", "rig": "pendulum", "parameter": parameter, "truth": 2.0,
         "low": 1.5, "high": high, "converged": np.arange(n) >= failed}
    )  # fmt: skip


def test_ninety_of_a_hundred_reach_both_aims():
    table = coverage_table(pd.concat([made(91), made(89, parameter="stiffness")]))
    assert list(table["parameter"]) == ["torque", "stiffness", ""]
    assert list(table["held"]) == [0.91, 0.89, 0.90]
    assert list(table["n"]) == [100, 100, 200]
    assert table.iloc[-1]["held_low"] < 0.9 < table.iloc[-1]["held_high"]
    assert list(table["width_over_value"]) == [0.5] * 3
    assert [aim.reached for aim in coverage_aims(table)] == [True, True]


def test_narrow_and_wide_intervals_are_seen_where_the_pooled_share_is_right():
    table = coverage_table(pd.concat([made(79), made(100, parameter="stiffness")]))
    pooled, each = coverage_aims(table)
    assert pooled.reached
    assert not each.reached
    assert each.measured == "torque of spring: 79.0 %, stiffness of spring: 100.0 %"


def test_what_did_not_converge_misses():
    table = coverage_table(made(95, failed=10))
    assert table.iloc[0]["held"] == 0.85
    assert table.iloc[0]["not_converged"] == 0.1
    assert not coverage_aims(table)[0].reached


def test_a_fit_that_failed_altogether_misses():
    lost = made(95)
    lost.loc[:9, ["low", "high"]] = np.nan
    lost.loc[:9, "converged"] = False
    assert coverage_table(lost).iloc[0][["held", "not_converged"]].tolist() == [0.85, 0.1]


def test_values_are_drawn_from_priors_within_what_is_possible():
    parameters = [Parameter("free", "1", 2.0, 5.0), Parameter("size", "1", 3.0, low=0.0)]
    effect, rng = JointEffect("part", parameters), np.random.default_rng(0)
    values = np.array([draw_from_prior(effect, rng) for _ in range(4000)])
    assert values.mean(0) == pytest.approx([5.0, 3.0 * np.sqrt(2 / np.pi)], abs=0.15)
    assert values[:, 0].std() == pytest.approx(2.0, rel=0.05)
    assert values[:, 1].min() >= 0


def test_every_variant_has_the_simplest_rig_that_it_shows_on():
    assert calibrated_effects("viscous_friction") == [CalibratedEffect("viscous_friction", "", "pendulum")]
    assert [tested.rig for tested in calibrated_effects("wind")] == ["ball"]
    assert [tested.rig for tested in calibrated_effects("external_pulse")] == ["pendulum"]
    assert {tested.variant: tested.rig for tested in calibrated_effects("encoder_scale")} == {
        "of the recorded encoder alone": "pendulum",
        "that the servo reads too": "arm",
    }


@pytest.mark.parametrize("name", RIGS)
def test_motions_of_the_rigs_are_finite_and_differ(name):
    simulated = calibration_rig(name)
    motion = simulated.draw(5, 0.2, np.random.default_rng(0))
    recording = simulate_recording(simulated, motion, None, np.zeros(0))
    table = recording.signals[next(iter(simulated.channels.values())).clock]
    seen = table[[o.channel for o in simulated.rig.observations]].to_numpy()
    assert len(seen) == 5 * round(0.2 / INTERVAL)
    assert np.isfinite(seen).all()
    assert (seen[39::40].std(axis=0) > 1e-3).all()


def test_a_thrown_ball_with_drag_flies_as_its_equation_says():
    simulated = calibration_rig("ball")
    start = np.zeros((1, 13))
    start[0, [2, 3, 7, 9]] = 1.0, 1.0, 3.0, 2.0
    motion = Motion(start, np.zeros((1, 100, 0)))
    nominal = segment_recording(simulate_recording(simulated, motion, None, np.zeros(0)), simulated.rig)
    (effect,) = LinearDrag.instances(Problem.of(simulated.rig, simulated.channels, nominal).rig_motion)
    recording = simulate_recording(simulated, motion, effect, np.array([0.02]))
    mass, t = 0.05, np.arange(100) * INTERVAL
    way = solve_ivp(
        lambda _, s: [s[2], s[3], -0.02 / mass * s[2], -9.81 - 0.02 / mass * s[3]],
        (0, t[-1]), [0, 1.0, 3.0, 2.0], t_eval=t, rtol=1e-9,
    )  # fmt: skip
    seen = recording.signals["camera"]
    assert seen["x"].to_numpy() == pytest.approx(way.y[0], abs=5e-4)
    assert seen["z"].to_numpy() == pytest.approx(way.y[1], abs=5e-4)


def test_a_fit_for_real(tmp_path):
    (tmp_path / "block").mkdir()
    config = {"effect": "viscous_friction", "seed": 3, "first": 1, "count": 1, "episodes": 5, "seconds": 0.5}
    stage_law_intervals.produce(Run(config, {}, tmp_path / "block", 1))
    (tmp_path / "table").mkdir()
    stage_coverage_table.produce(
        Run({"blocks": ["viscous_friction/1"]}, {"viscous_friction/1": tmp_path / "block"},
            tmp_path / "table", 1)
    )  # fmt: skip
    (row,) = intervals(calibrated_effects("viscous_friction")[0], 4, 5, 0.5)
    assert row["converged"]
    # Five standard deviations, not the interval: a test must not fail by chance.
    assert abs(row["value"] - row["truth"]) < 5 * (row["high"] - row["low"]) / 3.29
    written = pd.read_csv(tmp_path / "table/intervals.csv").iloc[0]
    assert written["truth"] == pytest.approx(row["truth"], rel=1e-5)
    table = pd.read_csv(tmp_path / "table/coverage.csv")
    assert list(table["effect"]) == ["viscous_friction", "all"]
    assert "none outside 80.0 % to 97.0 %" in (tmp_path / "table/coverage.md").read_text()


def test_the_filter_finds_an_elastic_joint_as_probable_as_simulation_does(monkeypatch):
    """Two ways to one number: a filter about a motion, and simulation of whole segments without any force.

    A filter about a motion far from the data would need a process force, and move the values.
    """
    found: dict[str, list[float]] = {"simulated": [], "filtered": []}
    shoot, evidence_of = structural_search.shoot, structural_search._evidence_of

    def simulated(*arguments, **more):
        fit = shoot(*arguments, **more)
        found["simulated"].append(fit.log_evidence)
        return fit

    def filtered(*arguments):
        evidence, fit, noise = evidence_of(*arguments)
        found["filtered"].append(evidence)
        assert noise.force < 1e-3
        return evidence, fit, noise

    monkeypatch.setattr(structural_search, "shoot", simulated)
    monkeypatch.setattr(structural_search, "_evidence_of", filtered)
    tested = CalibratedEffect("joint_elasticity", "read at the link", "pendulum")
    rows = list(intervals(tested, 500005, 6, 1.0))
    assert found["filtered"][-1] == pytest.approx(found["simulated"][-1], abs=3.0)
    for row in rows:
        assert row["converged"]
        assert row["low"] < row["truth"] < row["high"]
