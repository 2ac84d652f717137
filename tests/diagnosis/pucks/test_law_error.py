"""Errors of nominal laws among the nuisance of the mismatch test."""

import numpy as np
import pytest
from slapshot.diagnosis.inference.mismatch_test import Scores, mismatch_test
from slapshot.diagnosis.pucks.launch.strikes import TIMESTEP
from slapshot.diagnosis.pucks.selection.law_error import with_law_errors
from slapshot.diagnosis.pucks.slide.slide_model import Column

HITS, PRIOR = 150, 0.03  # s, of a delay
SPEED = 1.5  # m/s
SD = 0.1 * TIMESTEP  # s, to which all hits together tell one


def scores(delay, rng, owner):
    """Of hits that are all late by some seconds, in units of the prior."""
    information = np.full((HITS, 1, 1), PRIOR**2 / SD**2 / HITS)
    score = information[:, :, 0] * delay / PRIOR + np.sqrt(information[:, :, 0]) * rng.normal(size=(HITS, 1))
    of = Scores(score, information, np.array([PRIOR]), np.zeros(1, bool))
    return with_law_errors(of, [Column(owner, "delay", -1, 1e-3)], [], np.log(0.3), SPEED)


@pytest.mark.parametrize("owner", ["command_delay", "camera_time"])
@pytest.mark.parametrize(("steps", "seen"), [(1.0, False), (10.0, True)])
def test_a_delay_of_one_time_step_is_no_mismatch_and_one_of_ten_is(owner, steps, seen):
    """Of a normal prior of one step: ten of them have a probability of 1e-23, one of a third."""
    rng = np.random.default_rng(0)
    test = mismatch_test(scores(steps * TIMESTEP, rng, owner), [np.array([0])], rng, count=199)
    assert (test.p_value < 0.01) == seen


def test_other_delays_are_not_forgiven():
    rng = np.random.default_rng(0)
    test = mismatch_test(scores(TIMESTEP, rng, "shutter"), [np.array([0])], rng, count=199)
    assert test.p_value < 0.01


@pytest.mark.parametrize(("share", "seen"), [(0.01, False), (0.1, True)])
@pytest.mark.parametrize("parameter", ["faster_0", "sideways_3", "spin_0"])
@pytest.mark.parametrize("form", ["free_contact", "free_launch"])
def test_a_launch_may_err_by_a_hundredth_of_its_speed(share, seen, parameter, form):
    """Which all hits together tell to a thousandth; of spin nothing is forgiven."""
    rng = np.random.default_rng(1)
    prior, sd = 0.1, 0.001 * SPEED
    information = np.full((HITS, 1, 1), prior**2 / sd**2 / HITS)
    score = information[:, :, 0] * share * SPEED / prior
    score += np.sqrt(information[:, :, 0]) * rng.normal(size=(HITS, 1))
    of = Scores(score, information, np.array([prior]), np.zeros(1, bool))
    known = with_law_errors(of, [Column(form, parameter, -1, 1e-3)], [], np.log(0.3), SPEED)
    test = mismatch_test(known, [np.array([0])], rng, count=199)
    assert (test.p_value < 0.01) == (seen or parameter == "spin_0")
