"""What a recording cannot tell apart: by evidence, and by what laws err."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from slapshot.diagnosis.pucks.selection.judgement import (
    _beside_what_is_left,
    _class,
    mismatch_of,
    outside_probability,
    parameters_of,
)
from slapshot.diagnosis.pucks.selection.search import Candidate, Screen
from slapshot.diagnosis.pucks.slide.slide_model import Column
from slapshot.effects.catalogue import catalogue

GAIN = 2000.0  # nats of what was named
DISPERSION = 2.0


def candidate(name, misfit, cost=0.0):
    """Of one effect that fits worse by some nats, and whose parameters cost more by some."""
    fit = SimpleNamespace(objective=2 * DISPERSION * misfit, dispersion=DISPERSION)
    return Candidate((name,), fit, GAIN - misfit - cost, None)


def members(known_to, *rivals):
    named = candidate("lag", 0.0)
    search = SimpleNamespace(
        seen={(): candidate("", GAIN), **{c.effects: c for c in (named, *rivals)}},
        catalogue=["lag", "delay", "map", "stuck"],
        known_to=lambda name: known_to,
        gain=lambda at, name: GAIN,
        ahead=lambda one, other: one.log_evidence - other.log_evidence,
        at_bound=lambda candidate: candidate.effects == ("stuck",),
    )
    return _class(search, named, (), "lag")


def test_rivals_are_told_apart_by_what_laws_do_not_err_by():
    """A law that errs by 15 % leaves 2 % of its evidence, here 45 nats, either way."""
    assert set(members(0.15, candidate("delay", 40.0), candidate("map", 400.0))) == {"lag", "delay"}


def test_exact_laws_are_told_apart_by_evidence():
    assert set(members(0.0, candidate("delay", 40.0), candidate("map", 2.0))) == {"lag", "map"}
    assert members(0.0, candidate("map", 2.0))["lag"] == pytest.approx(0.8808, abs=1e-4)  # 1 / (1 + e^-2)


def test_what_fits_best_at_a_bound_stands_in_for_nothing():
    """However well it fits, and even where it is ahead of what is named."""
    assert set(members(0.0, candidate("stuck", -1.0), candidate("map", 2.0))) == {"lag", "map"}


def test_what_is_named_is_in_its_own_class_though_a_rival_is_far_ahead():
    assert set(members(0.0, candidate("map", -10.0))) == {"lag", "map"}


def test_what_was_not_simulated_where_it_is_stands_in_for_nothing():
    near = replace(candidate("map", 1.0), final=False)
    assert set(members(0.0, near, candidate("delay", 2.0))) == {"lag", "delay"}


def test_what_parameters_cost_counts_whatever_laws_err_by():
    assert set(members(0.15, candidate("map", 0.0, cost=20.0))) == {"lag"}


def test_a_mismatch_is_found_by_its_p_value_however_small_it_is():
    for p_value, evidence, found in ((0.005, 10.0, True), (0.02, 10.0, False), (0.005, 1.0, False)):
        screen = Screen({"tilt": evidence}, {"tilt": 1e-4}, p_value, {})
        assert mismatch_of(screen, 0.01, 2.0).found == found


def test_beside_what_is_left_a_value_is_that_of_a_fit_of_both():
    """Against dense least squares of one effect and a free form on 40 readings."""
    rng = np.random.default_rng(0)
    by = rng.normal(size=(40, 2)) + np.array([1.0, 1.0])
    readings = by @ [0.3, 0.5] + rng.normal(size=40)
    columns = [Column("tilt", "slope_x", -1, 0.1), Column("free", "weight", -1, 0.1)]
    alone = by[:, 0] @ readings / (by[:, 0] @ by[:, 0])  # at whose fit the effect has no score left
    left = readings - alone * by[:, 0]
    marginal = SimpleNamespace(information=(by.T @ by)[None], scores=(by.T @ left)[None])
    fitter = SimpleNamespace(
        quadratic=lambda fit, effects: (columns, marginal, None), prior=lambda columns: (None, np.zeros(2))
    )
    fit = SimpleNamespace(dispersion=1.0, columns=columns[:1])
    final = Candidate(("tilt",), fit, 0.0, fitter)
    for evidence in (3.0, -1.0):
        screen = Screen({"free": evidence}, {"free": 0.0}, 0.5, {})
        beside = _beside_what_is_left(SimpleNamespace(free=["free"]), final, screen)
        if evidence < 0:
            assert beside is None
            continue
        moved, sd = beside
        both = np.linalg.solve(by.T @ by, by.T @ readings)
        assert alone + moved == pytest.approx(both[:1])
        assert sd == pytest.approx(np.sqrt(np.linalg.inv(by.T @ by)[0, 0]))


def test_an_interval_holds_that_beside_what_is_left_over():
    """One slope 0.1 with sd 0.01; beside a free form it would be 0.05 with sd 0.02."""
    columns = [Column("object", "log_mu_x", 0, 0.01), Column("tilt", "slope_x", -1, 0.001)]
    marginal = SimpleNamespace(scores=np.zeros((3, 2)))
    values = {"tilt": {"slope_x": 0.1}}
    fit = SimpleNamespace(
        columns=columns,
        covariance=np.diag([1.0, 0.01**2]),
        marginal=marginal,
        point=SimpleNamespace(effects=values),
    )
    search = SimpleNamespace(fitter=SimpleNamespace(effects=catalogue()))
    (alone,) = parameters_of(search, fit, "tilt")
    assert (alone.low, alone.high) == pytest.approx((0.1 - 0.01645, 0.1 + 0.01645))
    beside = np.array([0.0, -0.05]), np.array([1.0, 0.02])
    (wide,) = parameters_of(search, fit, "tilt", beside)
    assert (wide.value, wide.low, wide.high) == pytest.approx((0.1, 0.05 - 0.0329, 0.1 + 0.01645))


def test_what_is_in_no_catalogue_is_as_probable_as_its_flag_makes_it():
    """By Bayes' rule from a table of 1,000 mismatches, 100 of which are in no catalogue."""
    flagged_outside, flagged_inside = 100 * 9 / 13, 900 * 1 / 42
    flagged = flagged_outside / (flagged_outside + flagged_inside)
    plain = (100 - flagged_outside) / (1000 - flagged_outside - flagged_inside)
    assert outside_probability(True) == pytest.approx(flagged)
    assert outside_probability(False) == pytest.approx(plain)
    assert plain < 0.1 < flagged
